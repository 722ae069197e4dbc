"""Draw rows, voxels and the size of a pixel for docs/conventions.md, from the package's own geometry:

PYTHONPATH=. python docs/images/make_grids.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from docs.images.make_conventions import BEAM, INK, MOVED, QUIET, arrow
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

import grainmotion as gm

PANEL = (6, 8)  # rows, columns
PIXEL = 0.5  # mm
SOURCE_TO_AXIS, SOURCE_TO_DETECTOR = 20.0, 40.0  # mm
GRAIN = np.array([0.4, 0.0, 0.35])  # x y z, mm
VOXELS = (3, 2, 4)  # z, y, x
VOXEL = 0.5  # mm


def views(first_row: str) -> gm.Geometry:
    """One view at θ = 0."""
    return gm.Geometry.cone(
        [0.0],
        PANEL,
        PIXEL,
        source_to_axis=SOURCE_TO_AXIS,
        source_to_detector=SOURCE_TO_DETECTOR,
        panel=gm.DetectorAlignment(first_row=first_row),
    )


def draw() -> Figure:
    """Two radiographs of one grain, the voxels of a volume, and a pixel at the axis."""
    figure = Figure(figsize=(9.4, 6.2), facecolor="white", layout="constrained")
    axes = figure.subplots(2, 2, width_ratios=[1, 1.2]).T.flat
    radiograph(axes[0], "bottom")
    radiograph(axes[1], "top")
    voxels(axes[2], gm.Volume.zeros(VOXELS, VOXEL))
    magnification(axes[3])
    for axis in axes:
        axis.set_aspect("equal")
        axis.axis("off")
    figure.get_layout_engine().set(rect=(0, 0, 1, 0.98))  # leaves room for the titles
    return figure


def radiograph(axis: Axes, first_row: str) -> None:
    """The panel as the source sees it, up upwards: x to the right, z up, mm on the panel."""
    view = views(first_row)
    axis.set_title(f'first_row = "{first_row}"', color=INK, family="monospace")
    row, column = view.project_points(GRAIN[None])[0, 0]
    for r in range(PANEL[0]):
        for c in range(PANEL[1]):
            corner = view.pixel_positions(0)[r, c][[0, 2]] - PIXEL / 2
            axis.add_patch(Rectangle(tuple(corner), PIXEL, PIXEL, fc="white", ec=QUIET, lw=0.6))
    first = view.pixel_positions(0)[0, 0][[0, 2]]
    axis.add_patch(Rectangle(tuple(first - PIXEL / 2), PIXEL, PIXEL, fc=MOVED, ec=QUIET, alpha=0.35))
    axis.text(*(first - [0.5, 0.0]), "[0, 0]", color=MOVED, ha="right", va="center", fontsize=9)
    place = (view.detector[0] + (column - (PANEL[1] - 1) / 2) * view.u[0] + (row - (PANEL[0] - 1) / 2) * view.v[0])[
        [0, 2]
    ]
    axis.add_patch(Circle(tuple(place), 0.42, color=INK, alpha=0.45, lw=0))
    axis.text(0, -2.1, f"this grain: row {row:.1f}, column {column:.1f}", color=INK, ha="center", fontsize=9)
    arrow(axis, first, 2 * view.v[0][[0, 2]], "v", MOVED, shift=(0.22, 0))
    arrow(axis, first, 2 * view.u[0][[0, 2]], "u", MOVED, shift=(0, 0.22))
    axis.set_xlim(-3.6, 2.4)
    axis.set_ylim(-2.4, 1.9)


def voxels(axis: Axes, volume: gm.Volume) -> None:
    """The layer y = 0 of a small volume, seen from -y: x to the right, z up."""
    nz, _, nx = volume.shape
    axis.set_title(f"array[z, y, x], shape {volume.shape}", color=INK)
    for k in range(nz):
        for i in range(nx):
            center = volume.origin[[0, 2]] + volume.voxel_size * np.array([i, k])
            corner = center - volume.voxel_size / 2
            axis.add_patch(Rectangle(tuple(corner), VOXEL, VOXEL, fc="white", ec=QUIET, lw=0.8))
            axis.plot(*center, ".", color=INK, ms=3)
            axis.text(*np.add(center, (0, 0.07)), f"{k},0,{i}", color=INK, ha="center", va="bottom", fontsize=8)
    axis.plot(*volume.origin[[0, 2]], "o", color=MOVED, ms=6)
    axis.text(*(volume.origin[[0, 2]] - [0, 0.42]), "origin", color=MOVED, ha="center", fontsize=9)
    axis.plot(volume.center[0], volume.center[2], "x", color=BEAM, ms=8, mew=2)
    axis.text(0, 0.95, "× center, of the whole array", color=BEAM, ha="center", fontsize=9)
    corner = volume.origin[[0, 2]] - [0.65, 0.0]
    arrow(axis, corner, np.array([0, 0.8]), "z", shift=(0, 0.14))
    arrow(axis, corner - [-0.35, 0.62], np.array([0.8, 0]), "x", shift=(0.14, 0))
    axis.set_xlim(-1.6, 1.2)
    axis.set_ylim(-1.35, 1.2)


def magnification(axis: Axes) -> None:
    """A pixel of the panel and its size at the axis, not to scale across the beam."""
    axis.set_title("a pixel at the axis", color=INK)
    at_axis = views("bottom").pixel_at([0.0, 0.0, 0.0])
    wide = 12.0  # sizes across the beam are drawn as many times larger
    source = np.array([-SOURCE_TO_AXIS, 0.0])
    for x, size in ((0.0, at_axis), (SOURCE_TO_DETECTOR - SOURCE_TO_AXIS, PIXEL)):
        axis.plot([x, x], [-wide * size / 2, wide * size / 2], color=MOVED, lw=3, solid_capstyle="butt")
    for sign in (-1, 1):
        end = [SOURCE_TO_DETECTOR - SOURCE_TO_AXIS, sign * wide * PIXEL / 2]
        axis.plot(*np.array([source, end]).T, color=BEAM, lw=0.7)
    axis.plot(*source, "o", color=INK, ms=6)
    axis.text(*np.add(source, (0, 1.4)), "source", color=INK, ha="center", fontsize=9)
    axis.text(0, wide * at_axis / 2 + 0.8, "axis", color=INK, ha="center", fontsize=9)
    axis.text(SOURCE_TO_DETECTOR - SOURCE_TO_AXIS, wide * PIXEL / 2 + 0.8, "panel", color=INK, ha="center", fontsize=9)
    lengths = ((SOURCE_TO_AXIS, "source_to_axis", -4.6), (SOURCE_TO_DETECTOR, "source_to_detector", -7.2))
    for length, name, level in lengths:
        style = {"arrowstyle": "<->", "color": QUIET}
        axis.annotate("", (source[0] + length, level), (source[0], level), arrowprops=style)
        axis.text(source[0] + length / 2, level + 0.5, name, color=QUIET, ha="center", fontsize=9)
    axis.text(
        0,
        -10.2,
        f"pixel_size × source_to_axis / source_to_detector\n= {PIXEL} × {SOURCE_TO_AXIS:g} / {SOURCE_TO_DETECTOR:g}"
        f" = {at_axis:g} mm: a good voxel_size",
        color=INK,
        ha="center",
        va="top",
        fontsize=9,
    )
    axis.set_xlim(-23, 24)
    axis.set_ylim(-15, 7)


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_name("grids.svg"))
