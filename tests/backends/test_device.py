"""Which device is chosen, and what is said where it cannot be."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from grainmotion.backends import device
from grainmotion.backends.device import CPU, Device, chosen, place, zeros_beside
from grainmotion.errors import BackendError


@pytest.fixture
def fresh():
    """Forget what was found of the card, before and after."""
    device._lacking.cache_clear()
    yield
    device._lacking.cache_clear()


def without_package(name: str) -> None:
    return None


def test_the_processor_needs_nothing(fresh, monkeypatch):
    monkeypatch.setattr(device, "find_spec", without_package)
    assert chosen("cpu") == CPU


def test_auto_without_the_package_is_the_processor(fresh, monkeypatch):
    monkeypatch.setattr(device, "find_spec", without_package)
    assert chosen("auto") == CPU


def test_cuda_without_the_package_names_the_extra(fresh, monkeypatch):
    monkeypatch.setattr(device, "find_spec", without_package)
    with pytest.raises(BackendError, match=r"numba-cuda is not installed; install grainmotion\[gpu\]"):
        chosen("cuda")


def test_cuda_without_a_card_names_the_driver(fresh):
    cuda = pytest.importorskip("numba.cuda", reason="numba-cuda is not installed")
    if cuda.is_available():
        pytest.skip("a card is there")
    assert chosen("auto") == CPU
    with pytest.raises(BackendError, match=r"no NVIDIA card can be used .* check the card and its driver"):
        chosen("cuda")


def test_a_card_that_fails_is_not_chosen(fresh, monkeypatch):
    cuda = pytest.importorskip("numba.cuda", reason="numba-cuda is not installed")

    class Broken:
        @staticmethod
        def try_card() -> None:
            raise RuntimeError("no kernel image is available\nfor execution")

    monkeypatch.setattr(cuda, "is_available", lambda: True)
    monkeypatch.setattr(device, "_cuda", lambda name: Broken)

    assert chosen("auto") == CPU
    with pytest.raises(BackendError, match="no kernel image is available for execution"):
        chosen("cuda")


def test_arrays_of_the_host_are_the_processors():
    array = np.ones(3, np.float32)
    assert place(array) == CPU
    assert CPU.hold(array) is array
    beside = zeros_beside(array, (2, 4))
    assert isinstance(beside, np.ndarray)
    assert beside.dtype == np.float32
    assert beside.shape == (2, 4)


def test_rooms_of_a_device_have_the_same_functions():
    pytest.importorskip("numba_cuda", reason="numba-cuda is not installed")
    for room, names in {
        "grain_projection": ("project", "project_with_derivatives", "add_patches"),
        "normal_equations": ("filter_images", "filter_patches", "gradients", "blocks"),
    }.items():
        for name in names:
            assert callable(getattr(CPU.kernels(room), name))
            assert callable(getattr(Device("cuda").kernels(room), name))


def test_the_package_does_not_import_the_card_unasked():
    code = "import sys, grainmotion; assert 'grainmotion.kernels.cuda' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
