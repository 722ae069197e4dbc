"""What is done to patches of grains, on the processor or on the card, wherever their arrays lie.

Arguments are those of `kernels.normal` and `kernels.grains`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.device import CPU, Device, place, zeros_beside

Image = NDArray[np.floating]
Index = NDArray[np.int64]
Float = NDArray[np.float64]


def filter_images(images: Image, weights: Image, device: Device = CPU) -> None:
    """Filter radiographs ``(n, rows, columns)`` of the host in place."""
    device.kernels("normal").filter_images(images, weights)


def filter_patches(derivatives: Any, boxes: Index, offsets: Index, valid: Image, weights: Image) -> None:
    """Mask, then filter each patch of ``(k, pixels)`` in place."""
    place(derivatives).kernels("normal").filter_patches(derivatives, boxes, offsets, valid, weights)


def gradients(derivatives: Any, boxes: Any, offsets: Any, images: Any, out: Float) -> None:
    """Dot products ``out (patches, 6)`` of patches with ``images (views, rows, columns)``."""
    place(derivatives).kernels("normal").gradients(derivatives, boxes, offsets, images, out)


def spread(
    derivatives: Any, boxes: Any, offsets: Any, order: Any, first: Any, increments: Float, panels: tuple[int, int, int]
) -> Any:
    """The images ``(views, rows, columns)`` that ``increments (n, 6)`` make, where the derivatives lie."""
    images = zeros_beside(derivatives, panels)
    spread_into(images, derivatives, boxes, offsets, order, first, increments)
    return images


def spread_into(
    images: Any, derivatives: Any, boxes: Any, offsets: Any, order: Any, first: Any, increments: Float
) -> None:
    """The same, filling images that lie where the derivatives do."""
    where = place(derivatives).kernels("normal")
    where.spread(derivatives, boxes, offsets, order, first, np.ascontiguousarray(increments), images)


def blocks(derivatives: Any, boxes: Index, offsets: Index, pairs: Index, first: Index, out: Float) -> None:
    """6×6 blocks ``out (blocks, 6, 6)`` of JᵀJ."""
    place(derivatives).kernels("normal").blocks(derivatives, boxes, offsets, pairs, first, out)
