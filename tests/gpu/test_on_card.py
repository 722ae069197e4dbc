"""The card computes what the processor does, to stated tolerances.

Without a card the same work is done by CUDA's simulator, in a process of its own: it must be asked for before numba
is imported.  The processor's side is compiled as ever.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gpu import work
from grainmotion.backends.device import backend_of
from grainmotion.errors import BackendError

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install grainmotion[dev]")

# Of the largest value, by precision: sums of some 10 voxels, then of some 1000 pixels, each in another order.
ROUNDING = {np.dtype(np.float32): 2e-6, np.dtype(np.float64): 1e-13}
SIMULATOR = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}


@pytest.fixture(scope="session", params=["simulator", "card"])
def card(request, tmp_path_factory) -> dict:
    """What all tasks return when they are done on the card."""
    if request.param == "card":
        try:
            backend_of("cuda")
        except BackendError as error:
            pytest.skip(str(error))
    out = tmp_path_factory.mktemp("card") / "results.pkl"
    paths = os.pathsep.join(p for p in sys.path if p)
    environment = {**os.environ, "PYTHONPATH": paths, **(SIMULATOR if request.param == "simulator" else {})}
    command = [sys.executable, work.__file__, str(out), *work.TASKS]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return pickle.loads(Path(out).read_bytes())


def assert_equal(got: dict, wanted: dict, rounding: float, each: dict[str, float] | None = None) -> None:
    """All of what a task returned, each by its largest value."""
    assert got.keys() == wanted.keys()
    for name, value in wanted.items():
        bound = (each or {}).get(name, rounding)
        largest = np.abs(value).max()
        assert largest > 0
        assert got[name].dtype == value.dtype
        assert np.abs(got[name] - value).max() <= bound * largest, name


@pytest.mark.parametrize(("task", "precision"), [("single", np.float32), ("double", np.float64), ("exact", np.float64)])
def test_patches_of_moving_grains_equal_the_processors(card, task, precision):
    wanted = work.done(task)
    assert wanted["derivatives"].dtype == precision

    assert_equal(card[task], wanted, ROUNDING[np.dtype(precision)])


@pytest.mark.parametrize("task", ["volume", "exact volume", "parallel volume"])
def test_whole_volumes_equal_the_processors(card, task):
    assert_equal(card[task], work.done(task), 1e-12)


@pytest.mark.parametrize("task", ["volume", "exact volume", "parallel volume"])
def test_back_projection_is_the_adjoint_of_projection(card, task):
    x, y = work.volume_and_images("parallel" if task == "parallel volume" else "cone")
    forward, adjoint = card[task]["forward"], card[task]["adjoint"] - x

    assert np.vdot(forward, y) == pytest.approx(np.vdot(x, adjoint), rel=1e-11)


@pytest.mark.parametrize("method", ["sart", "accelerated"])
def test_reconstruction_equals_the_processors(card, method):
    # some ten updates in single precision, by atomic additions whose order is not told
    assert_equal(card[method], work.done(method), 1e-5)


def test_patches_repeat_bit_by_bit(card):
    for name, value in card["single"].items():
        assert np.array_equal(value, card["single again"][name]), name


def test_normal_equations_of_a_state_equal_the_processors(card):
    assert_equal(card["linearized"], work.done("linearized"), 5e-6)


def test_finite_differences_are_honoured_on_the_card(card):
    # a difference over a hundredth of a voxel magnifies rounding a hundredfold
    assert_equal(card["differences"], work.done("differences"), 3e-4)


def test_tracked_state_equals_the_processors(card):
    wanted, got = work.done("tracked"), card["tracked"]

    assert list(got["statuses"]) == list(wanted["statuses"]) == ["converged", "converged"]
    assert np.abs(got["translations"] - wanted["translations"]).max() < 1e-5 * work.VOXEL
    assert np.abs(got["rotations"] - wanted["rotations"]).max() < 1e-5
    assert np.allclose(got["covariances"], wanted["covariances"], rtol=1e-3)
    assert np.abs(got["translations"] - work.truth().translations).max() < 0.02 * work.VOXEL
