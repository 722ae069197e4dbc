"""Lazy imports: `import grainmotion` and `--help` load none of the slow libraries."""

import subprocess
import sys

import pytest

SLOW_LIBRARIES = (
    "numpy", "numba", "scipy", "skimage", "pandas", "h5py", "matplotlib", "jinja2", "dask", "tifffile",
)  # fmt: skip
MAX_MODULES = 550
"""Modules that help, version and completion load: 0.2 to 0.4 CPU seconds.

Nearly all are those of typer (which reads options by pydantic), rich and Python; of grainmotion `MAX_OWN_MODULES`."""
MAX_OWN_MODULES = 45
HELP_CODE = """
from typer.testing import CliRunner
from grainmotion.cli.app import app
result = CliRunner().invoke(app, ["{}--help"])
assert result.exit_code == 0, result.output
"""


@pytest.mark.parametrize("code", ["import grainmotion", HELP_CODE.format(""), HELP_CODE.format('plan", "')])
def test_slow_libraries_are_not_loaded(code):
    program = f"{code}\nimport sys\nprint(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    loaded = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.split()
    assert not set(loaded) & set(SLOW_LIBRARIES)


COMMANDS = [
    ["--help"],
    ["--version"],
    ["version"],
    ["run", "--help"],
    ["export", "dem", "-h"],
    ["rnu"],
    ["run", "--frob"],
]


@pytest.mark.parametrize("words", [*COMMANDS, []], ids=" ".join)
def test_what_needs_no_data_is_fast(words):
    """Help, version, mistakes and, without words, completion."""
    program = f"""
import os, sys
sys.argv = ["grainmotion", *{words!r}]
if not {words!r}:
    os.environ.update(_GRAINMOTION_COMPLETE="complete_bash", COMP_WORDS="grainmotion run ", COMP_CWORD="2")
from grainmotion.__main__ import main
try:
    main()
finally:
    print(*sorted(sys.modules), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    loaded = done.stderr.splitlines()[-1].split()
    assert not {name.partition(".")[0] for name in loaded} & set(SLOW_LIBRARIES)
    assert len(loaded) < MAX_MODULES
    assert sum(name.startswith("grainmotion") for name in loaded) < MAX_OWN_MODULES


def test_a_public_name_loads_its_own_module_only():
    code = "import sys, grainmotion\ngrainmotion.Geometry\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert "grainmotion.model.geometry" in loaded
    assert not {"numba", "skimage", "matplotlib"} & set(loaded)
