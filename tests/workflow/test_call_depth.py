"""Depth of calls: number of functions of the package from the command `run` to the kernel that projects grains."""

import sys

from typer.testing import CliRunner

from grainmotion.cli import app
from grainmotion.kernels import grain_projection
from tiny_experiment import write_tiny

MAX_FRAMES = 12
"""In every fit, the function that carries out the command and the backend that calls the kernel included."""
MAX_FRAMES_OF_TRIAL_ROTATIONS = 17
"""The same bound for trial rotations of the identifiability test, which is made once for each state."""


def functions_on_the_stack():
    """Names of the package's functions on the call stack, from the function that carries out the command inwards."""
    names, frame = [], sys._getframe(2)
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if module.startswith("grainmotion."):
            names.append(f"{module.removeprefix('grainmotion.')}.{frame.f_code.co_qualname}")
        frame = frame.f_back
    return names[: names.index("cli.stages.run_stages") + 1][::-1]


def test_calls_from_the_command_to_the_kernel_are_few(tmp_path, monkeypatch):
    kernel, stacks = grain_projection.project_with_derivatives, set()

    def recorded(*arguments):
        stacks.add(tuple(functions_on_the_stack()))
        return kernel(*arguments)

    monkeypatch.setattr(grain_projection, "project_with_derivatives", recorded)
    result = CliRunner().invoke(app.app, ["run", str(write_tiny(tmp_path)), "--quiet"])
    assert result.exit_code == 0, result.output
    fits = [stack for stack in stacks if "solvers.gauss_newton.gauss_newton" in stack]
    deepest = max(fits, key=len)
    assert len(deepest) <= MAX_FRAMES, "\n".join(deepest)
    assert max(map(len, stacks)) <= MAX_FRAMES_OF_TRIAL_ROTATIONS
