"""The GPU benchmark runs through, in CUDA's simulator; without a GPU it makes no table."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from grainmotion.backends.device import backend_of
from grainmotion.errors import BackendError

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install grainmotion[dev]")

ROOT = Path(__file__).parents[2]
BENCHMARK = ROOT / "validation" / "benchmarks" / "gpu.py"


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess:
    paths = os.pathsep.join([str(ROOT), *(p for p in sys.path if p)])
    variables = {**os.environ, "PYTHONPATH": paths, **environment}
    return subprocess.run(
        [sys.executable, "-m", "validation.benchmarks.gpu", *arguments],
        env=variables,
        capture_output=True,
        text=True,
    )


@pytest.mark.slow
def test_smallest_benchmark_runs_and_its_results_are_right():
    toy = ["--toy", "--grains", "2", "--across", "4", "--repeats", "1", "--compare", "2"]
    result = run(*toy, NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")

    assert result.returncode == 0, result.stdout + result.stderr[-2000:]
    assert "CUDA's simulator: times mean nothing" in result.stdout
    for row in ("one sweep, all on the GPU", "values and derivatives", "filter of derivatives", "gradient"):
        assert row in result.stdout


def test_without_a_gpu_there_is_no_table():
    try:
        backend_of("cuda")
    except BackendError:
        table = BENCHMARK.parent / "results" / "gpu.md"
        before = table.read_text() if table.exists() else None
        result = run()
        assert result.returncode == 2
        assert "no GPU benchmark, and no table" in result.stderr
        assert result.stdout == ""
        assert (table.read_text() if table.exists() else None) == before
    else:
        pytest.skip("there is a GPU")
