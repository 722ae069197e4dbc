"""What all figures share: new axes where none are given, planes of the sample frame, colours and colour bars."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from mpl_toolkits.mplot3d.axes3d import Axes3D

Plane = Literal["xy", "xz", "yz"]
PLANES: Mapping[str, tuple[int, int]] = MappingProxyType({"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)})
"""Planes of the sample frame, and which of x, y, z run to the right and upwards in them."""
LINE_COLOURS = ("#2f7ed8", "#d9722e", "#2a9d68", "#b8478f", "#8a6d1f", "#5b6ee1", "#c0392b", "#16909b")
SEQUENTIAL, DIVERGING, GREYS = "viridis", "RdBu_r", "gray"
"""Colour maps of amounts, of values of both signs, and of attenuation."""
UNUSED_COLOUR = "0.6"
"""Colour of grains without a result to use."""
TEXT_SIZE = 8.0
"""Of notes inside axes, points."""
MIN_FRAME_RATIO = 0.6
"""Of the longer side of a plane's frame, for the shorter one."""


def axes_of(ax: Axes | None, size: tuple[float, float] = (6.0, 4.5)) -> Axes:
    """The axes that are given, or those of a new figure of ``size`` inches."""
    if ax is not None:
        if getattr(ax, "name", "") == "3d":
            remedy = "make them by plt.subplots(), or leave ax out"
            raise InputError("ax", "the axes have three dimensions, the figure has two", remedy)
        return ax
    import matplotlib.pyplot as plt  # so that a notebook shows the new figure

    return plt.subplots(figsize=size, layout="compressed")[1]  # a colour bar gets the height of equally scaled axes


def axes_3d_of(ax: Axes3D | None, size: tuple[float, float] = (6.5, 5.5)) -> Axes3D:
    """The axes in three dimensions that are given, or those of a new figure."""
    if ax is None:
        import matplotlib.pyplot as plt

        figure = plt.figure(figsize=size, layout="constrained")
        return cast("Axes3D", figure.add_subplot(projection="3d"))
    if getattr(ax, "name", "") != "3d":
        remedy = 'make them by figure.add_subplot(projection="3d"), or leave ax out'
        raise InputError("ax", "the axes have two dimensions, the figure has three", remedy)
    return ax


def plane_axes(plane: str) -> tuple[int, int]:
    """Which of x, y, z run to the right and upwards in a plane."""
    if plane not in PLANES:
        raise InputError("plane", f"'{plane}' is unknown", f"use {', '.join(PLANES)}")
    return PLANES[plane]


def frame_plane(ax: Axes, plane: str, points: Float, around: float = 0.0) -> None:
    """Equal scales, names of the axes, and limits with room ``around`` points ``(n, 2)`` of a plane, mm."""
    ax.set_aspect("equal")
    ax.set_xlabel(f"{plane[0]} (mm)")
    ax.set_ylabel(f"{plane[1]} (mm)")
    points = points[np.isfinite(points).all(axis=1)]
    if len(points):
        low, high = points.min(axis=0), points.max(axis=0)
        room = max(around, 0.12 * float((high - low).max())) or 1.0
        middle, half = (low + high) / 2, (high - low) / 2 + room
        half = np.maximum(half, MIN_FRAME_RATIO * half.max())  # arrows in a slit would have no heads
        ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
        ax.set_ylim(middle[1] - half[1], middle[1] + half[1])


def colour_bar(ax: Axes, drawn: ScalarMappable, label: str) -> None:
    """A colour bar beside the axes."""
    figure = ax.get_figure(root=True)
    assert figure is not None  # axes are made by a figure
    figure.colorbar(drawn, ax=ax, label=label, fraction=0.046, pad=0.03, aspect=26)


def legend_beside(ax: Axes, size: str | None = None) -> None:
    """A legend to the right of the axes, where it covers nothing; none where nothing has a name."""
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=size)


def checked_scale(scale: float | None) -> float | None:
    """A factor for lengths in a figure, which turns nothing round; None for one that the figure chooses."""
    if scale is not None and not 0 < scale < np.inf:
        raise InputError("scale", f"it is {scale:g}", "give a positive number, or leave it out")
    return scale


def note(ax: Axes, text: str) -> None:
    """What a reader must know of the figure, as its title until the user sets another."""
    if text:
        ax.set_title(text, fontsize="medium")


def round_factor(wanted: float) -> float:
    """The largest of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not above ``wanted``."""
    if not (np.isfinite(wanted) and wanted > 0):
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(m for m in (1, 2, 3, 4, 5, 6, 8) if m * power <= wanted * (1 + 1e-9)))
