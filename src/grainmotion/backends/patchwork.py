"""What is done to patches of grains, on the processor or on the card, wherever their arrays lie.

Arguments are those of `kernels.normal_equations` and `kernels.grain_projection`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.device import CPU, Device, place


def filter_images(images: Image, weights: Image, device: Device = CPU) -> None:
    """Filter radiographs ``(n, rows, columns)`` of the host in place."""
    device.kernels("normal_equations").filter_images(images, weights)


def filter_patches(derivatives: Any, boxes: Index, offsets: Index, valid: Image, weights: Image) -> None:
    """Mask, then filter each patch of ``(k, pixels)`` in place."""
    place(derivatives).kernels("normal_equations").filter_patches(derivatives, boxes, offsets, valid, weights)


def gradients(derivatives: Any, boxes: Any, offsets: Any, stacks: Any) -> Float:
    """Dot products ``(k, patches, 6)`` of patches with each of k ``stacks (views, rows, columns)``."""
    out = np.zeros((len(stacks), len(boxes), 6))
    place(derivatives).gradients(derivatives, boxes, offsets, stacks, out)
    return out


def spread(
    derivatives: Any, boxes: Any, offsets: Any, order: Any, first: Any, increments: Float, panels: tuple[int, int, int]
) -> Any:
    """The k stacks ``(views, rows, columns)`` that ``increments (k, n, 6)`` make, where the derivatives lie.

    They are added up in double, as `grains.assemble` does, and in the derivatives' precision.
    """
    increments = np.ascontiguousarray(increments)
    return place(derivatives).spread(derivatives, boxes, offsets, order, first, increments, panels)


def blocks(derivatives: Any, boxes: Index, offsets: Index, pairs: Index, first: Index, out: Float) -> None:
    """6×6 blocks ``out (blocks, 6, 6)`` of JᵀJ."""
    place(derivatives).kernels("normal_equations").blocks(derivatives, boxes, offsets, pairs, first, out)
