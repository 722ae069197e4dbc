"""Device: where rays are walked, on the processor, on an NVIDIA card, or by the workers of a cluster.

It is chosen once, where grains or a volume are handed to it (`Device.hold`); from there on the place of an
array says which kernels take it, those of the processor, `kernels.cuda` or `cluster.dask_backend`, of the same names
and arguments.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any, ClassVar, Literal

import numpy as np

from grainmotion.errors import BackendError

Choice = Literal["auto", "cpu", "cuda"]
"""``"auto"``: the card if there is one that works, else the processor."""


@dataclass(frozen=True)
class Device:
    """Where kernels run."""

    name: Literal["cpu", "cuda", "workers"]
    walks_coarse: ClassVar[bool] = False
    """Whether grains on coarser voxels are handed to it, too; else the processor walks them."""

    def hold(self, array: Any) -> Any:
        """An array where the device can walk it: itself, or a copy that stays on the card."""
        return array if self.name == "cpu" else _cuda("device_array").hold(array)

    def hold_voxels(self, images: Any, starts: Any, heights: Any, size: float) -> Any:
        """The same for voxels of grains, one grain after the other from ``starts (n,)`` on.

        ``heights (n,)`` are the grains' z, ``size`` is that of their voxels over the reference's.
        """
        return self.hold(images)

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """Zeros where the device can walk them."""
        return np.zeros(shape, dtype) if self.name == "cpu" else _cuda("device_array").zeros(shape, dtype)

    def gradients(self, derivatives: Any, boxes: Any, offsets: Any, stacks: Any, out: Any) -> None:
        """Fill ``out (k, patches, 6)``, see `patchwork.gradients`."""
        for images, found in zip(stacks, out, strict=True):
            self.kernels("normal_equations").gradients(derivatives, boxes, offsets, images, found)

    def spread(
        self, derivatives: Any, boxes: Any, offsets: Any, order: Any, first: Any, increments: Any, panels: Any
    ) -> Any:
        """k stacks, see `patchwork.spread`."""
        stacks = []
        for each in increments:
            images = self.zeros(panels, float if self.name == "cpu" else derivatives.dtype)
            self.kernels("normal_equations").spread(derivatives, boxes, offsets, order, first, each, images)
            stacks.append(images.astype(derivatives.dtype, copy=False) if self.name == "cpu" else images)
        return stacks

    def for_grains(
        self, function: Callable[..., Any], grains: Any, pose: Any, images: tuple[Any, ...], how: Any
    ) -> Any:
        """``function(grains, pose, *images, how)``, an array of a row a grain, done where their voxels are."""
        return function(grains, pose, *images, how)

    def kernels(self, name: str) -> Any:
        """A room of `kernels` by its name, or its counterpart on the card."""
        return _cuda(name) if self.name == "cuda" else importlib.import_module(f"grainmotion.kernels.{name}")


CPU, CARD = Device("cpu"), Device("cuda")


def chosen(choice: Choice) -> Device:
    """The device of a choice.

    Raises
    ------
    BackendError
        If ``"cuda"`` is asked for where numba-cuda or a working card is lacking.
    """
    if choice == "cpu":
        return CPU
    lacking = _lacking()
    if lacking is None:
        return Device("cuda")
    if choice == "auto":
        return CPU
    raise BackendError("device 'cuda'", *lacking)


def place(array: Any) -> Device:
    """Where an array lies."""
    if isinstance(array, np.ndarray):
        return CPU
    device: Device = getattr(array, "walked_by", CARD)
    return device


def zeros_beside(array: Any, shape: int | tuple[int, ...]) -> Any:
    """Zeros of an array's precision, where it lies."""
    shape = (shape,) if isinstance(shape, int) else shape
    return place(array).zeros(shape, array.dtype)


def _cuda(name: str) -> ModuleType:
    return importlib.import_module(f"grainmotion.kernels.cuda.{name}")


@cache
def _lacking() -> tuple[str, str] | None:
    """What keeps the card from being used and what to do about it; None if nothing does."""
    instead = 'or give device = "cpu"'
    if find_spec("numba_cuda") is None:
        return "the package numba-cuda is not installed", f"install grainmotion[gpu] {instead}"
    try:
        from numba import cuda
    except ImportError as error:
        return f"numba-cuda cannot be used ({_line(error)})", f"install grainmotion[gpu] anew {instead}"
    if not cuda.is_available():
        told = _line(cuda.cuda_error()) if cuda.cuda_error() else "no card answers"
        return f"no NVIDIA card can be used ({told})", f"check the card and its driver with nvidia-smi {instead}"
    try:
        _cuda("device_array").try_card()
    except Exception as error:  # drivers, compilers and cards fail in many ways; each is a reason not to use them
        return f"the card cannot run kernels ({_line(error)})", f"install grainmotion[gpu], update the driver {instead}"
    return None


def _line(error: object) -> str:
    words = " ".join(str(error).split())
    return words if len(words) <= 200 else f"{words[:200]}…"
