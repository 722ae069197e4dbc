"""Results do not depend on the processor: the same cases compiled for several, their motions compared.

Each target is a process of its own, with its own compiled kernels (in ``.targets``, so that a second run is quick).
Motions of converged grains agree to 0.05 of their standard deviation or 1e-4 voxel, whichever is larger, rotations at
the rim of a grain; statuses are the same.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding

from grainmotion.rotations import rotation_matrix, rotation_vector

pytestmark = pytest.mark.targets
ROOT = Path(__file__).parents[2]
KERNEL_CACHE, SOURCE = ROOT / ".targets", ROOT / "src" / "grainmotion"
MAX_OF_SD, MAX_OF_VOXEL = 0.05, 1e-4
SOLVER_TESTS = ("solvers/test_gauss_newton.py", "solvers/test_semidefinite.py")
MAX_PROCESSES = 2  # processes, of one thread each
PLANAR_SAMPLES, ALL_PLANAR_SAMPLES = 1, 4  # of Table 2; all by `make test-all`: the second is searched for a minute

AVX2 = frozenset({"avx2", "fma", "bmi2"})
AVX512 = AVX2 | {"avx512f", "avx512vl", "avx512bw", "avx512dq"}


@cache
def kernels() -> str:
    """Short hash of the source of all kernels: numba does not notice that a kernel calls another that has changed."""
    files = sorted((SOURCE / "kernels").rglob("*.py"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()[:8]


@dataclass(frozen=True)
class Target:
    """A processor for which kernels are compiled, or whose BLAS kernels are used; ``needs`` are its instructions.

    ``like`` another one are those with the same instructions or BLAS kernels, or with the host's where they run at
    all: only `make test-all` tests them.
    """

    name: str
    variable: str = "NUMBA_CPU_NAME"
    needs: frozenset[str] = frozenset()
    like: str = ""

    @property
    def can_run(self) -> bool:
        """Whether this processor has the instructions."""
        return all(binding.get_host_cpu_features().get(n) for n in self.needs)

    def measured(self, folder: Path, samples: int) -> Path:
        """Run all cases, and the solver's tests if BLAS is what differs; returns the file of the motions."""
        out = folder / f"{self.variable}-{self.name}.npz"
        variables = {self.variable: self.name, "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        variables["PYTHONPATH"] = os.pathsep.join([str(ROOT / "tests"), str(ROOT)])
        if self.variable == "NUMBA_CPU_NAME":  # only what that processor has, whatever more this one can do
            variables |= {"NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(KERNEL_CACHE / kernels() / self.name)}
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_CPU", "OPENBLAS_CORETYPE"))}
        solver = [
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            *(str(ROOT / "tests" / name) for name in SOLVER_TESTS),
        ]
        commands = [[str(Path(__file__).with_name("cases.py")), str(out), str(samples)]]
        if self.variable != "NUMBA_CPU_NAME":  # the solver has no compiled kernels
            commands.append(solver)
        for command in commands:
            result = subprocess.run(
                [sys.executable, *command], env=environment | variables, cwd=folder, capture_output=True, text=True
            )
            assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
        return out


HOST = Target("host", "GRAINMOTION_TARGET")
TARGETS = (
    Target("generic"),
    Target("haswell", needs=AVX2),
    Target("znver3", needs=AVX2 | {"sse4a", "vaes"}, like="haswell"),
    Target("skylake-avx512", needs=AVX512, like="host"),
    Target("Haswell", "OPENBLAS_CORETYPE", AVX2),
    Target("Zen", "OPENBLAS_CORETYPE", AVX2, like="Haswell"),
    Target("SkylakeX", "OPENBLAS_CORETYPE", AVX512, like="host"),
)


@pytest.fixture(scope="module")
def results(request, tmp_path_factory) -> Iterator[dict[Target, Future[Path]]]:
    """Start the targets whose tests are to run; compiled kernels of an earlier source are removed."""
    calls = [item.callspec for item in request.session.items if "results" in item.fixturenames]
    chosen = [HOST, *(call.params["target"] for call in calls)]
    samples = ALL_PLANAR_SAMPLES if any(t.like for t in chosen) else PLANAR_SAMPLES
    folder = tmp_path_factory.mktemp("targets")
    for old in KERNEL_CACHE.glob("*"):
        if old.name != kernels():
            shutil.rmtree(old)
    with ThreadPoolExecutor(MAX_PROCESSES) as pool:
        yield {t: pool.submit(t.measured, folder, samples) for t in chosen if t.can_run}


@pytest.mark.parametrize(
    "target",
    [pytest.param(t, id=f"{t.variable}={t.name}", marks=[pytest.mark.slow] if t.like else []) for t in TARGETS],
)
def test_motions_are_those_of_the_host(results, target):
    if not target.can_run:
        pytest.skip(f"this processor lacks one of {', '.join(sorted(target.needs))}")
    with np.load(results[HOST].result()) as of_host, np.load(results[target].result()) as of_target:
        blas = ", ".join(of_target["blas"])  # it may use kernels of a related processor: Haswell's for Zen
        names = sorted({key.split("/")[0] for key in of_host.files if "/" in key})
        differences = {name: compared(of_host, of_target, name) for name in names}
    print(f"\n{'largest difference on ' + target.name:34} of sd   voxel   (BLAS: {blas})")
    for name, (of_sd, of_voxel, _) in differences.items():
        print(f"{name:34} {of_sd:.4f}  {of_voxel:.1e}")
    wrong = {name: fault for name, (_, _, fault) in differences.items() if fault}
    assert not wrong


def compared(of_host, of_target, name: str) -> tuple[float, float, str]:
    """Largest difference of converged grains (in sd, in voxels at the rim), and what is wrong with it."""
    one, other = ({key: arrays[f"{name}/{key}"] for key in KEYS} for arrays in (of_host, of_target))
    if one["rough"]:
        return np.nan, np.nan, "" if np.isfinite(other["translations"]).all() else "no result"
    if list(one["statuses"]) != list(other["statuses"]):
        return np.inf, np.inf, f"statuses {one['statuses']} and {other['statuses']}"
    compared_rows = np.isin(one["statuses"], ["converged", "poorly-determined"])
    rotations = rotation_vector(
        rotation_matrix(other["rotations"]) @ np.swapaxes(rotation_matrix(one["rotations"]), 1, 2)
    )
    differences = np.abs(np.hstack([other["translations"] - one["translations"], rotations]))[compared_rows]
    assert compared_rows.any()
    assert np.isfinite(differences).all()
    voxels = differences / np.repeat([one["voxel"], one["voxel"] / one["radius"]], 3)
    sds = np.divide(
        differences,
        one["sds"][compared_rows],
        out=np.full_like(differences, np.inf),
        where=one["sds"][compared_rows] > 0,
    )
    sds[voxels == 0] = 0
    excess = np.minimum(sds / MAX_OF_SD, voxels / MAX_OF_VOXEL)
    fault = f"grain {np.argmax(excess.max(axis=1))} is {excess.max():.1f} times too far" if (excess > 1).any() else ""
    return float(sds.max(initial=0)), float(voxels.max(initial=0)), fault


KEYS = ("statuses", "translations", "rotations", "sds", "voxel", "radius", "rough")
