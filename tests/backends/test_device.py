"""`backend_of`: choice of CPU or GPU, and errors where a GPU cannot be used."""

from __future__ import annotations

import subprocess
import sys

import pytest

from grainmotion.backends import device
from grainmotion.backends.cpu import CPU
from grainmotion.backends.device import Device, backend_of
from grainmotion.errors import BackendError


@pytest.fixture
def clear_gpu_check():
    """Clear the cached result of the GPU's check, before and after the test."""
    device._cuda_problem.cache_clear()
    yield
    device._cuda_problem.cache_clear()


def package_not_installed(name: str) -> None:
    """Replaces `find_spec` as if no package were installed."""
    return None


def test_cpu_needs_no_package(clear_gpu_check, monkeypatch):
    monkeypatch.setattr(device, "find_spec", package_not_installed)
    assert backend_of("cpu") == CPU


def test_auto_without_the_package_is_the_cpu(clear_gpu_check, monkeypatch):
    monkeypatch.setattr(device, "find_spec", package_not_installed)
    assert backend_of("auto") == CPU


def test_cuda_without_the_package_names_the_extra(clear_gpu_check, monkeypatch):
    monkeypatch.setattr(device, "find_spec", package_not_installed)
    with pytest.raises(BackendError, match=r"numba-cuda is not installed; install grainmotion\[gpu\]"):
        backend_of("cuda")


def test_cuda_without_a_gpu_names_the_driver(clear_gpu_check):
    cuda = pytest.importorskip("numba.cuda", reason="numba-cuda is not installed")
    if cuda.is_available():
        pytest.skip("a GPU is available")
    assert backend_of("auto") == CPU
    with pytest.raises(BackendError, match=r"no NVIDIA card can be used .* check the card and its driver"):
        backend_of("cuda")


def test_gpu_that_fails_its_check_is_not_used(clear_gpu_check, monkeypatch):
    cuda = pytest.importorskip("numba.cuda", reason="numba-cuda is not installed")

    from grainmotion.kernels.cuda import device_array

    def broken() -> None:
        raise RuntimeError("no kernel image is available\nfor execution")

    monkeypatch.setattr(cuda, "is_available", lambda: True)
    monkeypatch.setattr(device_array, "run_test_kernel", broken)

    assert backend_of("auto") == CPU
    with pytest.raises(BackendError, match="no kernel image is available for execution"):
        backend_of("cuda")


def test_device_equals_its_name_in_settings():
    assert Device("cuda") == "cuda"
    assert backend_of(Device.CPU) is backend_of("cpu")


def test_the_package_does_not_import_gpu_code_unasked():
    everything = "import grainmotion as gm, grainmotion.workflow.run; [getattr(gm, name) for name in gm.__all__]"
    code = f"import sys; {everything}; assert 'grainmotion.kernels.cuda' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
