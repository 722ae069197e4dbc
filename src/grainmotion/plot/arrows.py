"""Motions of grains as arrows at their centres, projected onto a plane or in three dimensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.plot.canvas import (
    SEQUENTIAL,
    UNUSED_COLOUR,
    Plane,
    axes_3d_of,
    axes_of,
    checked_scale,
    colour_bar,
    frame_plane,
    note,
    plane_axes,
    round_factor,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d.axes3d import Axes3D

Quantity = Literal["translation", "fluctuation", "rotation"]
QUANTITY_LABELS = {"translation": "|u| (mm)", "fluctuation": "|u − mean| (mm)", "rotation": "|ω| (°)"}
ARROW_LENGTH_SHARE = 0.2
"""Of the sample's size, for the longest arrow."""
ARROW_WIDTH = 0.025
"""Of the shaft, inches: in narrow axes heads of arrows stay as large as in wide ones."""
MIN_BOX_RATIO = 0.5
"""Of the longest side of a figure's box in three dimensions, for its other sides."""


@checked_arguments
def motions(
    motions: Motions,
    *,
    plane: Plane = "xz",
    quantity: Quantity = "translation",
    scale: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Motions of all grains as arrows at their centres, seen along one axis.

    Parameters
    ----------
    motions : Motions
        Of one state.  Grains whose translation (or rotation) is no result to use are grey crosses.
    plane : {"xz", "yz", "xy"}
        The plane of the figure, the first to the right; arrows are projected onto it, colours tell their whole length.
    quantity : {"translation", "fluctuation", "rotation"}
        u; u less its mean over the grains; or the rotation vector ω.
    scale : float, optional
        Length of an arrow over that of the translation; of a rotation, mm for a degree.  By default such that the
        longest arrow spans a fifth of the sample.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In mm of the sample frame; a note tells the scale.

    Raises
    ------
    InputError
        If the plane or the quantity is unknown.

    Examples
    --------
    >>> import grainmotion as gm
    >>> from dataclasses import replace
    >>> unmoved = gm.Motions.identity([1, 2, 3], [[0, 0, 0], [1, 0, 2], [2, 1, 1]])
    >>> moved = replace(unmoved, translations=0.1 * unmoved.centers, statuses=["converged"] * 3)
    >>> ax = gm.plot.motions(moved, plane="xz")
    """
    right, up = plane_axes(plane)
    vectors, used = arrow_vectors(motions, quantity)
    lengths = np.linalg.norm(vectors, axis=1)
    factor = checked_scale(scale) or arrow_scale(motions.centers, lengths)
    starts = motions.centers[:, [right, up]]
    ax = axes_of(ax)
    ax.plot(*starts[~used].T, "x", color=UNUSED_COLOUR, ms=5, zorder=1)
    shown = vectors[:, [right, up]]
    if used.any():
        drawn = ax.quiver(
            *starts[used].T, *(factor * shown[used]).T, lengths[used], cmap=SEQUENTIAL, angles="xy", scale_units="xy",
            scale=1, units="inches", width=ARROW_WIDTH, zorder=3,
        )  # fmt: skip
        drawn.set_clim(0, float(lengths[used].max()) or 1.0)
        ax.plot(*starts[used].T, "o", color="0.75", ms=3, zorder=2)
        colour_bar(ax, drawn, QUANTITY_LABELS[quantity])
    frame_plane(ax, plane, np.concatenate([starts, starts + factor * np.nan_to_num(shown)]))
    note(ax, scale_note(quantity, factor, int((~used).sum())))
    return ax


@checked_arguments
def motions_3d(
    motions: Motions, *, quantity: Quantity = "translation", scale: float | None = None, ax: Axes3D | None = None
) -> Axes3D:
    """Motions of all grains as arrows in three dimensions.

    Parameters
    ----------
    motions : Motions
        Of one state.  Grains whose translation (or rotation) is no result to use are grey crosses.
    quantity : {"translation", "fluctuation", "rotation"}
        u; u less its mean over the grains; or the rotation vector ω.
    scale : float, optional
        As in `motions`.
    ax : Axes3D, optional
        Where to draw, made with ``projection="3d"``; a new figure unless given.

    Returns
    -------
    Axes3D
        In mm of the sample frame.

    Raises
    ------
    InputError
        If the quantity is unknown, or the axes have two dimensions.

    Examples
    --------
    >>> import grainmotion as gm
    >>> from dataclasses import replace
    >>> unmoved = gm.Motions.identity([1, 2, 3], [[0, 0, 0], [1, 0, 2], [2, 1, 1]])
    >>> turned = replace(unmoved, rotations=0.1 * unmoved.centers, statuses=["converged"] * 3)
    >>> ax = gm.plot.motions_3d(turned, quantity="rotation")
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    vectors, used = arrow_vectors(motions, quantity)
    lengths = np.linalg.norm(vectors, axis=1)
    factor = checked_scale(scale) or arrow_scale(motions.centers, lengths)
    ax = axes_3d_of(ax)
    ax.scatter(*motions.centers[~used].T, marker="x", color=UNUSED_COLOUR)
    if used.any():
        scale_of_colours = ScalarMappable(Normalize(0, float(lengths[used].max()) or 1.0), SEQUENTIAL)
        colours = colormaps[SEQUENTIAL](scale_of_colours.norm(lengths[used]))
        ax.scatter(*motions.centers[used].T, color="0.75", s=6)
        ax.quiver(*motions.centers[used].T, *(factor * vectors[used]).T, colors=colours, lw=1.8, arrow_length_ratio=0.3)
        ax.figure.colorbar(scale_of_colours, ax=ax, label=QUANTITY_LABELS[quantity], shrink=0.7, pad=0.1)
    ends = np.concatenate([motions.centers, motions.centers + factor * np.nan_to_num(vectors)])
    if len(ends):
        _frame_box(ax, ends)
    ax.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    ax.set_title(scale_note(quantity, factor, int((~used).sum())), fontsize="medium")
    return ax


def _frame_box(ax: Axes3D, points: Float) -> None:
    """Equal scales, and limits with room around points ``(n, 3)``, mm."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = (high - low) / 2 + (0.05 * float((high - low).max()) or 1.0)
    half = np.maximum(half, MIN_BOX_RATIO * half.max())
    for axis, center, reach in zip("xyz", (low + high) / 2, half, strict=True):
        getattr(ax, f"set_{axis}lim")(center - reach, center + reach)
    ax.set_box_aspect(half / half.max())


def arrow_vectors(motions: Motions, quantity: Quantity) -> tuple[Float, NDArray[np.bool_]]:
    """Vectors ``(n, 3)``, mm or degrees, and which of them are results to use; the others are NaN."""
    if quantity not in QUANTITY_LABELS:
        raise InputError("quantity", f"'{quantity}' is unknown", f"use {', '.join(QUANTITY_LABELS)}")
    rotation = quantity == "rotation"
    used = motions.ok_rotation if rotation else motions.ok_translation
    vectors = np.rad2deg(motions.rotations) if rotation else np.asarray(motions.translations, dtype=float)
    vectors = np.where(used[:, None], vectors, np.nan)
    if quantity == "fluctuation" and used.any():
        vectors = vectors - vectors[used].mean(axis=0)
    return vectors, used


def arrow_scale(centers: Float, lengths: Float) -> float:
    """Round factor by which the longest arrow spans about a fifth of the sample; 1 where that is right within 2."""
    longest = float(np.max(lengths[np.isfinite(lengths)], initial=0.0))
    extent = float(np.ptp(centers, axis=0).max()) if len(centers) else 0.0
    wanted = ARROW_LENGTH_SHARE * extent / longest if longest > 0 else 1.0
    return 1.0 if wanted == 0 or 0.5 <= wanted <= 2 else round_factor(wanted)


def scale_note(quantity: Quantity, factor: float, without: int) -> str:
    """How long arrows are, and how many grains have none."""
    text = f"arrows: {factor:g} mm for 1°" if quantity == "rotation" else f"arrows × {factor:g}"
    return f"{text}; ×: {without} without a result" if without else text
