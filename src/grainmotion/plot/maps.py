"""Maps of the grains: any value as the colour of points at their centres, and standard deviations as ellipses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.strains import Strains
from grainmotion.model.motions import Motions
from grainmotion.model.status import STATUS_COLOURS
from grainmotion.plot.canvas import (
    DIVERGING,
    SEQUENTIAL,
    UNUSED_COLOUR,
    Plane,
    axes_of,
    checked_scale,
    colour_bar,
    frame_plane,
    legend_beside,
    note,
    plane_axes,
    round_factor,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection

LENGTH_COLUMNS = {"u": ("ux", "uy", "uz"), "w": ("wx", "wy", "wz")}
"""Lengths of vectors that can be drawn beside the columns of the table."""
TEXT_COLUMNS = ("status", "reason")
"""Columns of a table that hold no numbers."""
MARKER_SIZE = 150.0
"""Area of a point, points²; less where there are many grains."""
ELLIPSE_SHARE = 0.3
"""Of the distance between neighbouring centres, for the radius of an ellipse; neighbours may lie behind each other."""
LARGEST_ELLIPSE = 4.0
"""Radius of the largest ellipse that is drawn, over the usual one."""


@checked_arguments
def grain_map(
    motions: Motions | Strains,
    values: str | ArrayLike | None = None,
    *,
    label: str | None = None,
    plane: Plane = "xz",
    moved: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """A value of the grains as the colour of points at their centres.

    Parameters
    ----------
    motions : Motions or Strains
        Of one state.
    values : str or (n,) array
        A column of ``motions.to_dataframe()``, such as "uz", "sd_wx", "residual" or "status"; "u" or "w", the length
        of the translation (mm) or the angle of the rotation (degrees); of strains "volumetric", "deviatoric" and the
        others of ``strains.to_dataframe()``; or one number a grain.  Translations and rotations that are no results to
        use are grey, as NaN is.  Unless given, the status of motions and the volumetric strain of strains.
    label : str, optional
        Text of the colour bar; the name of the column with its unit unless given.
    plane : {"xz", "yz", "xy"}
        The plane of the figure, the first to the right.
    moved : bool
        Draw the centres where they are in the state, not where they were in the reference; not of strains.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In mm of the sample frame.

    Raises
    ------
    InputError
        If there is no such column, the array has not one number a grain, or strains are to be drawn at moved centres.

    Examples
    --------
    >>> import grainmotion as gm
    >>> grains = gm.Motions.identity([1, 2, 3], [[0, 0, 0], [1, 0, 2], [2, 1, 1]])
    >>> ax = gm.plot.grain_map(grains, "status")
    >>> ax = gm.plot.grain_map(grains, grains.centers[:, 2], label="height (mm)", plane="xy")
    """
    right, up = plane_axes(plane)
    centers = motions.centers
    if values is None:
        values = "status" if isinstance(motions, Motions) else "volumetric"
    if moved and isinstance(motions, Strains):
        raise InputError("moved", "strains do not hold where the grains are", "give motions, and the strain as values")
    if moved and isinstance(motions, Motions):
        centers = centers + np.nan_to_num(motions.translations)
    points = centers[:, [right, up]]
    ax = axes_of(ax)
    size = MARKER_SIZE * min(1.0, 40 / max(1, len(motions))) + 6
    edge = 0.4 * min(1.0, size / 40)  # the edges of many small points would hide their colours
    if isinstance(motions, Motions) and isinstance(values, str) and values == "status":
        for status, colour in STATUS_COLOURS.items():
            rows = motions.statuses == status
            if rows.any():
                ax.scatter(
                    points[rows, 0], points[rows, 1], s=size, color=colour, edgecolor="white", lw=edge, label=status
                )
        legend_beside(ax)
    else:
        numbers, name = _values(motions, values)
        known = np.isfinite(numbers)
        ax.scatter(points[~known, 0], points[~known, 1], s=size, color=UNUSED_COLOUR, marker="x")
        drawn = ax.scatter(points[known, 0], points[known, 1], s=size, c=numbers[known], edgecolor="0.3", lw=edge)
        _set_colours(drawn, numbers[known])
        colour_bar(ax, drawn, name if label is None else label)
        note(ax, f"×: {(~known).sum()} without a value" if not known.all() else "")
    frame_plane(ax, plane, points)
    return ax


@checked_arguments
def sd_ellipses(
    motions: Motions,
    *,
    plane: Plane = "xz",
    rotation: bool = False,
    scale: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Standard deviations of the translations (or rotations) in a plane, an ellipse a grain.

    A long ellipse is a direction that the views determine badly, usually that of the rays.

    Parameters
    ----------
    motions : Motions
        Of one state.
    plane : {"xz", "yz", "xy"}
        The plane of the figure, the first to the right.
    rotation : bool
        Of the rotations, degrees, in place of the translations, mm.
    scale : float, optional
        Size of an ellipse over the standard deviation; of a rotation, mm for a degree.  By default such that the
        ellipses of most grains are near and do not touch; larger ones are drawn dashed and smaller than they are.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In mm of the sample frame; radii are one standard deviation along each direction, colours their largest.

    Raises
    ------
    InputError
        If the plane is unknown.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> from dataclasses import replace
    >>> grains = gm.Motions.identity([1, 2, 3], [[0, 0, 0], [1, 0, 2], [2, 1, 1]])
    >>> found = replace(grains, covariances=np.tile(np.diag([4, 1, 1, 4, 1, 1]) * 1e-6, (3, 1, 1)))
    >>> ax = gm.plot.sd_ellipses(found, plane="xz")
    """
    from matplotlib.collections import EllipseCollection

    axes = plane_axes(plane)
    points = motions.centers[:, axes]
    radii, angles = _ellipses(motions, axes, rotation=rotation)
    known = np.isfinite(radii).all(axis=1)
    usual = float(np.median(radii[known, 0])) if known.any() else 0.0
    factor = checked_scale(scale) or _ellipse_scale(motions.centers, usual)
    larger = known & (radii[:, 0] > LARGEST_ELLIPSE * usual) & (scale is None)
    shrunk = np.where(larger, LARGEST_ELLIPSE * usual / np.maximum(radii[:, 0], 1e-300), 1.0)[:, None] * radii
    ax = axes_of(ax)
    ax.plot(*points[~known].T, "x", color=UNUSED_COLOUR)
    ax.plot(*points[known].T, ".", color="0.4", ms=3)
    for rows, style in ((known & ~larger, "-"), (larger, "--")):
        if rows.any():
            widths, heights = 2 * factor * shrunk[rows].T
            drawn = EllipseCollection(
                widths, heights, angles[rows], units="xy", offsets=points[rows], offset_transform=ax.transData,
                facecolors="none", lw=1.6, linestyles=style, cmap=SEQUENTIAL,
            )  # fmt: skip
            drawn.set_array(radii[rows, 0])
            drawn.set_clim(0, float(radii[known & ~larger, 0].max()) or 1.0)
            ax.add_collection(drawn)
            if style == "-":
                colour_bar(ax, drawn, f"largest sd in the plane ({'°' if rotation else 'mm'})")
    frame_plane(ax, plane, points, around=1.1 * factor * float(np.nanmax(shrunk, initial=0.0)))
    text = f"1 sd: {factor:g} mm for 1°" if rotation else f"1 sd × {factor:g}"
    text += f"; dashed: {larger.sum()} larger than drawn" if larger.any() else ""
    note(ax, text + (f"; ×: {(~known).sum()} without sd" if not known.all() else ""))
    return ax


def _values(motions: Motions | Strains, values: str | ArrayLike) -> tuple[Float, str]:
    """One number a grain and its name; NaN for motions that are no results to use."""
    if not isinstance(values, str):
        numbers = np.asarray(values, dtype=float)
        if numbers.shape != (len(motions),):
            raise InputError("values", f"shape {numbers.shape}", f"give one number for each of {len(motions)} grains")
        return numbers, ""
    table = motions.to_dataframe()
    if values in LENGTH_COLUMNS and isinstance(motions, Motions):
        numbers = np.linalg.norm(table[list(LENGTH_COLUMNS[values])].to_numpy(float), axis=1)
        unit, name = ("mm", "|u|") if values == "u" else ("°", "|ω|")
    elif values in table.columns and values not in TEXT_COLUMNS:
        numbers = table[values].to_numpy(float)
        unit, name = table.attrs["units"][values].replace("deg", "°"), values
    else:
        names = [*(column for column in table.columns if column not in TEXT_COLUMNS)]
        names += ["status", *LENGTH_COLUMNS] if isinstance(motions, Motions) else []
        raise InputError("values", f"there is no column '{values}' of numbers", f"use one of {', '.join(names)}")
    if isinstance(motions, Motions):
        for part, columns in (("u", motions.ok_translation), ("w", motions.ok_rotation)):
            if values in (part, *LENGTH_COLUMNS[part]):
                numbers = np.where(columns, numbers, np.nan)
    return numbers, name if unit in ("1", "yes or no") else f"{name} ({unit})"


def _set_colours(drawn: PathCollection, values: Float) -> None:
    """Map and limits of the colours: symmetric about 0 for values of both signs."""
    both_signs = bool(values.size) and values.min() < 0 < values.max()
    drawn.set_cmap(DIVERGING if both_signs else SEQUENTIAL)
    if both_signs:
        limit = float(np.abs(values).max())
        drawn.set_clim(-limit, limit)


def _ellipses(motions: Motions, axes: tuple[int, int], *, rotation: bool) -> tuple[Float, Float]:
    """Radii ``(n, 2)``, mm or degrees, the larger first, and its direction ``(n,)``, degrees; NaN where unknown."""
    rows = np.array(axes) + (3 if rotation else 0)
    blocks = motions.covariances[:, rows[:, None], rows] * (np.rad2deg(1.0) ** 2 if rotation else 1.0)
    known = np.isfinite(blocks).all(axis=(1, 2))
    radii, angles = np.full((len(motions), 2), np.nan), np.full(len(motions), np.nan)
    values, vectors = np.linalg.eigh(blocks[known])
    radii[known] = np.sqrt(np.maximum(values[:, ::-1], 0))
    angles[known] = np.rad2deg(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    return radii, angles


def _ellipse_scale(centers: Float, usual: float) -> float:
    """Round factor by which the usual ellipse nearly fills the distance between neighbouring centres."""
    if len(centers) < 2 or usual <= 0:
        return 1.0
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(centers).query(centers, k=[2])
    apart = float(np.median(distances))
    return round_factor(ELLIPSE_SHARE * apart / usual)
