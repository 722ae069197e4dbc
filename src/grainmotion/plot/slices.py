"""Slices of a volume, with the outlines of its labels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume
from grainmotion.plot.canvas import GREYS, TEXT_SIZE, axes_of, colour_bar
from grainmotion.segmentation.segment import Segmentation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OUTLINE_COLOUR = "#ff9f1c"
MAX_NAMED_LABELS = 60
"""Labels of a slice that are written into it; more would cover it."""
ACROSS = {"z": ("xy", 0), "y": ("xz", 1), "x": ("yz", 2)}
"""By the axis across a slice: what runs to the right and upwards in it, and the axis of the array."""


@checked_arguments
def volume_slice(
    volume: Volume,
    labels: Segmentation | NDArray[np.integer] | None = None,
    *,
    axis: Literal["x", "y", "z"] = "z",
    at: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """One slice of a volume in grey, with the outlines and numbers of its labels.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : Segmentation or (nz, ny, nx) integer array, optional
        Labels of the same voxels, 0 for none.
    axis : {"z", "y", "x"}
        Axis across the slice.  x (or y) runs to the right, z (or y) upwards.
    at : float, optional
        Where the slice lies on this axis, mm; by default in the middle of the volume.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In mm of the sample frame.

    Raises
    ------
    InputError
        If the slice lies outside the volume, or the labels are of another grid.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> labels = np.zeros((20, 24, 24), int)
    >>> labels[5:15, 4:12, 4:12], labels[5:15, 12:20, 12:20] = 1, 2
    >>> ax = gm.plot.volume_slice(gm.Volume(0.05 * (labels > 0), voxel_size=0.1), labels, axis="z", at=0.2)
    """
    if axis not in ACROSS:
        raise InputError("axis", f"'{axis}' is unknown", 'use "x", "y" or "z"')
    shown = labels.labels if isinstance(labels, Segmentation) else None if labels is None else np.asarray(labels)
    if shown is not None and shown.shape != volume.shape:
        raise InputError("labels", f"shape {shown.shape}, the volume's is {volume.shape}", "give those of this volume")
    if shown is not None and shown.dtype.kind not in "iu":
        raise InputError("labels", f"they are {shown.dtype}", "give integers")
    plane, across = ACROSS[axis]
    index = _index(volume, axis, at)
    image = np.take(volume.array, index, across)
    right, up = ("xyz".index(name) for name in plane)
    edges = np.array([volume.origin[k] - volume.voxel_size / 2 for k in (right, up)])
    far = edges + volume.voxel_size * np.array(image.shape[::-1])
    ax = axes_of(ax, (5.6, 4.8))
    low, high = (float(image.min()), float(image.max())) if image.size else (0.0, 0.0)
    drawn = ax.imshow(
        image, cmap=GREYS, origin="lower", extent=(edges[0], far[0], edges[1], far[1]), vmin=low,
        vmax=high if high > low else low + 1.0,
    )  # fmt: skip
    colour_bar(ax, drawn, "attenuation (1/mm)")
    if shown is not None:
        _draw_labels(ax, np.take(shown, index, across), edges, volume.voxel_size)
    ax.set_xlabel(f"{plane[0]} (mm)")
    ax.set_ylabel(f"{plane[1]} (mm)")
    ax.set_title(f"{axis} = {volume.origin['xyz'.index(axis)] + index * volume.voxel_size:.3g} mm")
    return ax


def _index(volume: Volume, axis: str, at: float | None) -> int:
    """The voxel layer at a place on an axis."""
    k = "xyz".index(axis)
    count, first = volume.shape[2 - k], volume.origin[k]
    if at is None:
        return count // 2
    index = round((at - first) / volume.voxel_size) if np.isfinite(at) else -1
    if not 0 <= index < count:
        last = first + (count - 1) * volume.voxel_size
        raise InputError("at", f"{axis} = {at:g} mm is outside the volume", f"give {first:.4g} to {last:.4g} mm")
    return index


def _draw_labels(ax: Axes, labels: NDArray[np.integer], corner: Float, voxel_size: float) -> None:
    """Lines between voxels of different labels, and each label's number at its mean place."""
    from matplotlib.collections import LineCollection
    from matplotlib.patheffects import withStroke

    ax.add_collection(LineCollection(list(_borders(labels) * voxel_size + corner), colors=OUTLINE_COLOUR, lw=0.9))
    numbers, inverse = np.unique(labels, return_inverse=True)
    if not 0 < np.count_nonzero(numbers) <= MAX_NAMED_LABELS:
        return
    counts = np.bincount(inverse.ravel())
    rows, columns = np.indices(labels.shape)
    places = [np.bincount(inverse.ravel(), (n + 0.5).ravel()) / counts for n in (columns, rows)]
    for number, x, y in zip(numbers, *places, strict=True):
        if number > 0:
            text = ax.text(
                corner[0] + voxel_size * x, corner[1] + voxel_size * y, str(number), color=OUTLINE_COLOUR,
                fontsize=TEXT_SIZE, ha="center", va="center", weight="bold",
            )  # fmt: skip
            text.set_clip_on(True)
            text.set_path_effects([withStroke(linewidth=2, foreground="black")])


def _borders(labels: NDArray[np.integer]) -> Float:
    """Edges of voxels between two labels ``(k, 2, 2)``: column and row of both ends, from the corner of the slice."""
    padded = np.pad(labels, 1)  # outlines close at the edge of the slice
    row, column = np.nonzero(padded[:, 1:] != padded[:, :-1])  # a step to the right crosses an upright edge
    upright = np.stack([np.stack([column, row - 1], -1), np.stack([column, row], -1)], axis=1)
    row, column = np.nonzero(padded[1:] != padded[:-1])
    level = np.stack([np.stack([column - 1, row], -1), np.stack([column, row], -1)], axis=1)
    return np.concatenate([upright, level]).astype(float)
