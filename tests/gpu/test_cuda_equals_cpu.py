"""The CUDA backend computes what the CPU does, to the tolerances of each test.

Every test runs on numba's CUDA simulator and, if there is one, on a GPU. The simulator needs a separate process,
because it must be selected before numba is imported. The CPU's results come from compiled kernels in this process.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gpu import device_tasks
from grainmotion.backends.device import backend_of
from grainmotion.errors import BackendError

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install grainmotion[dev]")

# Tolerance relative to the largest value: sums over about 10 voxels and 1000 pixels are in another order on a GPU.
ROUNDING = {np.dtype(np.float32): 2e-6, np.dtype(np.float64): 1e-13}
# The CPU's exact path of upright panels shifts rays by 2^-30 voxel, off the borders between voxels (decision 0048).
ROUNDING_OF_VOLUMES = {"volume": 1e-12, "exact volume": 2.0**-29, "parallel volume": 1e-12}
SIMULATOR = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}


@pytest.fixture(scope="session", params=["simulator", "gpu"])
def cuda_results(request, tmp_path_factory) -> dict:
    """Results of all tasks on the simulator or the GPU, by name of the task."""
    if request.param == "gpu":
        try:
            backend_of("cuda")
        except BackendError as error:
            pytest.skip(str(error))
    out = tmp_path_factory.mktemp("gpu") / "results.pkl"
    paths = os.pathsep.join(p for p in sys.path if p)
    environment = {**os.environ, "PYTHONPATH": paths, **(SIMULATOR if request.param == "simulator" else {})}
    command = [sys.executable, device_tasks.__file__, str(out), *device_tasks.TASKS]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return pickle.loads(Path(out).read_bytes())


def assert_equal(computed: dict, expected: dict, rounding: float, rounding_of: dict[str, float] | None = None) -> None:
    """Compare all arrays of a task; bounds are relative to the largest value of each array."""
    assert computed.keys() == expected.keys()
    for name, value in expected.items():
        bound = (rounding_of or {}).get(name, rounding)
        largest = np.abs(value).max()
        assert largest > 0
        assert computed[name].dtype == value.dtype
        assert np.abs(computed[name] - value).max() <= bound * largest, name


@pytest.mark.parametrize(("task", "precision"), [("single", np.float32), ("double", np.float64), ("exact", np.float64)])
def test_patches_of_moving_grains_equal_those_of_the_cpu(cuda_results, task, precision):
    expected = device_tasks.run_task(task)
    assert expected["derivatives"].dtype == precision

    assert_equal(cuda_results[task], expected, ROUNDING[np.dtype(precision)])


@pytest.mark.parametrize("task", ["volume", "exact volume", "parallel volume"])
def test_whole_volumes_equal_those_of_the_cpu(cuda_results, task):
    assert_equal(cuda_results[task], device_tasks.run_task(task), ROUNDING_OF_VOLUMES[task])


@pytest.mark.parametrize("task", ["volume", "exact volume", "parallel volume"])
def test_back_projection_is_the_adjoint_of_projection(cuda_results, task):
    x, y = device_tasks.volume_and_images("parallel" if task == "parallel volume" else "cone")
    forward, adjoint = cuda_results[task]["forward"], cuda_results[task]["adjoint"] - x

    assert np.vdot(forward, y) == pytest.approx(np.vdot(x, adjoint), rel=1e-11)


@pytest.mark.parametrize("method", ["sart", "accelerated"])
def test_reconstruction_equals_that_of_the_cpu(cuda_results, method):
    # about ten updates in single precision, by atomic additions in no fixed order
    assert_equal(cuda_results[method], device_tasks.run_task(method), 1e-5)


def test_patches_are_reproducible_bit_by_bit(cuda_results):
    for name, value in cuda_results["single"].items():
        assert np.array_equal(value, cuda_results["single again"][name]), name


def test_normal_equations_of_a_state_equal_those_of_the_cpu(cuda_results):
    assert_equal(cuda_results["linearized"], device_tasks.run_task("linearized"), 5e-6)


def test_finite_differences_equal_those_of_the_cpu(cuda_results):
    # a difference over a hundredth of a voxel amplifies rounding by a factor of 100
    assert_equal(cuda_results["differences"], device_tasks.run_task("differences"), 3e-4)


def test_tracked_state_equals_that_of_the_cpu(cuda_results):
    expected, computed = device_tasks.run_task("tracked"), cuda_results["tracked"]

    assert list(computed["statuses"]) == list(expected["statuses"]) == ["converged", "converged"]
    assert np.abs(computed["translations"] - expected["translations"]).max() < 1e-5 * device_tasks.VOXEL
    assert np.abs(computed["rotations"] - expected["rotations"]).max() < 1e-5
    assert np.allclose(computed["covariances"], expected["covariances"], rtol=1e-3)
    assert np.abs(computed["translations"] - device_tasks.truth().translations).max() < 0.02 * device_tasks.VOXEL
