"""Slices of the reference volume and of its labels, for the page."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.model.volume import Volume
from grainmotion.report.embedding import Embedded, embed
from grainmotion.report.image_coding import block_means

SLICE_PIXELS = 1_500_000
"""Of all slices together: about 1.5 MB of the page."""
MOST_SLICES, FEWEST_SLICES = 33, 9
"""Along one axis; odd, so that one is in the middle."""
GREY_LEVELS = 128
"""Of attenuation: more are noise to the eye, and cost bytes."""
SLICE_AXES = (("z", "x", "y"), ("y", "x", "z"), ("x", "y", "z"))
"""Axis across the slices, axis to the right and axis upwards; in the order of the volume's axes."""


def slice_records(volume: Volume, labels: NDArray[np.integer] | None, grains: NDArray[np.integer]) -> dict[str, object]:
    """Slices through the volume along its three axes, with the grains in them.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array, optional
        On the voxels of the volume, 0 for no grain.
    grains : (n,) int array
        Labels of the grains in the page's order.

    Returns
    -------
    dict
        ``range`` (lowest and highest attenuation that is told apart, 1/mm), ``levels`` and ``planes``: for each
        ``axis``, the axes ``across`` and ``up``, ``positions`` of the slices, ``left`` and ``top`` end and ``size`` to
        the right and upwards, ``pixel`` (all mm), ``binning`` (voxels along the edge of a pixel), ``grey`` (one byte a
        pixel, uppermost row first) and ``grains`` (row of the grain + 1, 0 for none; row differences), or None without
        labels.
    """
    low, high = _range(volume.array)
    drawn: list[Embedded | None] = [None, None, None]
    if labels is not None:
        rows = _row_table(labels, grains)
        drawn = [_grains(labels, rows, axis) for axis in range(3)]
    return {
        "range": [low, high],
        "levels": GREY_LEVELS,
        "planes": [_plane(volume, axis, (low, high)) | {"grains": drawn[axis]} for axis in range(3)],
    }


def _plane(volume: Volume, axis: int, span: tuple[float, float]) -> dict[str, object]:
    name, right, up = SLICE_AXES[axis]
    chosen, edge = _choice(volume.shape, axis)
    grey = []
    for place in chosen:
        image = block_means(np.take(volume.array, place, axis)[::-1], edge)
        unit = np.clip((np.nan_to_num(image, nan=span[0]) - span[0]) / (span[1] - span[0]), 0, 1)
        grey.append(np.rint(unit * (GREY_LEVELS - 1)).astype(np.uint8))
    half = np.array(volume.shape[::-1]) / 2 * volume.voxel_size
    ends = [dict(zip("xyz", np.array(volume.center) + sign * half, strict=True)) for sign in (-1, 1)]
    center = volume.center[::-1][axis]
    steps = np.asarray(chosen) - (volume.shape[axis] - 1) / 2
    return {
        "axis": name,
        "across": right,
        "up": up,
        "positions": [float(f"{center + step * volume.voxel_size:.4g}") for step in steps],
        "left": float(ends[0][right]),
        "top": float(ends[1][up]),
        "size": [float(ends[1][side] - ends[0][side]) for side in (right, up)],
        "pixel": volume.voxel_size * edge,
        "binning": edge,
        "grey": embed(np.stack(grey)),
    }


def _grains(labels: NDArray[np.integer], rows: NDArray[np.uint16 | np.uint32], axis: int) -> Embedded:
    """Rows of the grains in the slices, those at the middles of pixels."""
    chosen, edge = _choice(labels.shape, axis)
    slices = []
    for place in chosen:
        picked = rows[np.maximum(np.take(labels, place, axis)[::-1], 0)]
        picked = np.pad(picked, [(0, -n % edge) for n in picked.shape], mode="edge")
        slices.append(picked[edge // 2 :: edge, edge // 2 :: edge])
    return embed(np.diff(np.stack(slices), axis=1, prepend=rows.dtype.type(0)))


def _choice(shape: tuple[int, ...], axis: int) -> tuple[list[int], int]:
    """Which slices across an axis are shown, and over how many voxels they are averaged."""
    count, pixels = shape[axis], math.prod(shape) // shape[axis]
    share = SLICE_PIXELS / len(SLICE_AXES)
    number = min(count, (int(np.clip(share // pixels, FEWEST_SLICES, MOST_SLICES)) - 1) // 2 * 2 + 1)
    edge = max(1, math.ceil(math.sqrt(pixels * number / share)))
    places = np.linspace(0, count, 2 * number + 1)[1::2]  # the middles of equal parts
    return sorted({int(place) for place in places}), edge


def _row_table(labels: NDArray[np.integer], grains: NDArray[np.integer]) -> NDArray[np.uint16 | np.uint32]:
    """For each label the row of its grain + 1, 0 if it is none of these grains."""
    kind = np.uint16 if len(grains) < 2**16 - 1 else np.uint32
    table: NDArray[np.uint16 | np.uint32] = np.zeros(max(*(int(a.max(initial=0)) for a in (labels, grains))) + 1, kind)
    table[grains] = np.arange(1, len(grains) + 1)
    return table


def _range(array: Image) -> tuple[float, float]:
    """Lowest and highest attenuation of a sample of the voxels, 1 in 500 clipped at either end."""
    stride = max(1, round((array.size / 2e6) ** (1 / 3)))
    array = array[::stride, ::stride, ::stride]
    values = array[np.isfinite(array)]
    if values.size == 0:
        return 0.0, 1.0
    low, high = (float(f"{end:.4g}") for end in np.quantile(values, [0.002, 0.998]))
    return low, high if high > low else low + 1.0
