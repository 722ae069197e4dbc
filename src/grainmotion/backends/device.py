"""Device: the choice between CPU and GPU, and the backend that it names."""

from __future__ import annotations

from enum import StrEnum
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal

from grainmotion.errors import BackendError, InputError

if TYPE_CHECKING:  # the command line and settings import this module, and need no kernels
    from grainmotion.backends.base import PatchBackend


class Device(StrEnum):
    """Where to compute: on the CPU, on an NVIDIA GPU, or on the GPU if one works and else on the CPU (auto).

    Examples
    --------
    >>> quick = gm.track(grains, state, settings=gm.TrackSettings(search=False), device=gm.Device.CPU)
    >>> bool(quick.ok.all())
    True
    """

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


DeviceName = Literal["auto", "cpu", "cuda"]
"""The value of a `Device`, as settings and experiment files give it."""


def backend_of(device: DeviceName | Device | PatchBackend) -> PatchBackend:
    """The backend of a device; a backend is its own.

    Raises
    ------
    BackendError
        If ``"cuda"`` is asked for where numba-cuda or a working GPU is lacking.
    """
    if not isinstance(device, str):
        return device
    if device not in tuple(Device):
        raise InputError("device", f"'{device}' is unknown", f"use {', '.join(Device)}")
    if uses_cuda(device):
        from grainmotion.backends.cuda import CudaBackend

        return CudaBackend()
    from grainmotion.backends.cpu import CPU

    return CPU


def uses_cuda(device: DeviceName | Device) -> bool:
    """Whether a device is the GPU; raises as `backend_of` does."""
    if device == "cpu":
        return False
    problem = _cuda_problem()
    if problem is not None and device == "cuda":
        raise BackendError("device 'cuda'", *problem)
    return problem is None


@cache
def _cuda_problem() -> tuple[str, str] | None:
    """Why the GPU cannot be used, and the remedy; None if it can."""
    instead = 'or give device = "cpu"'
    if find_spec("numba_cuda") is None:
        return "the package numba-cuda is not installed", f"install grainmotion[gpu] {instead}"
    try:
        from numba import cuda
    except ImportError as error:
        return f"numba-cuda cannot be used ({_one_line(error)})", f"install grainmotion[gpu] anew {instead}"
    if not cuda.is_available():
        reason = _one_line(cuda.cuda_error()) if cuda.cuda_error() else "no card answers"
        return f"no NVIDIA card can be used ({reason})", f"check the card and its driver with nvidia-smi {instead}"
    try:
        from grainmotion.kernels.cuda import device_array

        device_array.run_test_kernel()
    except Exception as error:  # drivers, compilers and GPUs fail in many ways; each is a reason not to use them
        return (
            f"the card cannot run kernels ({_one_line(error)})",
            f"install grainmotion[gpu], update the driver {instead}",
        )
    return None


def _one_line(error: object) -> str:
    words = " ".join(str(error).split())
    return words if len(words) <= 200 else f"{words[:200]}…"
