"""Draw the axes and signs for docs/conventions.md from the package's own geometry:

python docs/images/make_conventions.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon

import grainmotion as gm
from grainmotion.rotations import rotation_matrix

INK, QUIET, BEAM, MOVED = "#22303c", "#6b7884", "#c8963e", "#1b5e8c"
SHAPE = (8, 12)  # rows, columns
PIXEL = 0.5  # mm
SOURCE_TO_AXIS, SOURCE_TO_DETECTOR = 5.0, 8.0  # mm
TURNED_DEG = 35.0
GRAIN = np.array([[0.9, 0.1], [0.55, 0.75], [-0.3, 0.6], [-0.75, -0.1], [-0.2, -0.7], [0.5, -0.5]])


def draw() -> Figure:
    """Three drawings: from above on the left, from the side and a motion on the right."""
    figure = Figure(figsize=(9.4, 6.2), facecolor="white", layout="constrained")
    axes = list(figure.subplot_mosaic("AB;AC", width_ratios=[1, 1.05], height_ratios=[1, 1.1]).values())
    views = gm.Geometry.cone(
        [0.0, TURNED_DEG], SHAPE, PIXEL, source_to_axis=SOURCE_TO_AXIS, source_to_detector=SOURCE_TO_DETECTOR
    )
    from_above(axes[0], views)
    from_the_side(axes[1], views)
    motion(axes[2])
    for axis in axes:
        axis.set_aspect("equal")
        axis.axis("off")
    figure.get_layout_engine().set(rect=(0, 0, 1, 0.98))  # leaves room for the titles
    return figure


def arrow(axis: Axes, start: np.ndarray, step: np.ndarray, text: str, colour: str = INK, shift=(0.0, 0.0)) -> None:
    """An arrow with a name at its end."""
    end = np.add(start, step)
    axis.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}
    )
    axis.text(*(end + shift), text, color=colour, ha="center", va="center")


def turn(axis: Axes, center: tuple[float, float], radius: float, first: float, last: float, text: str, at=None) -> None:
    """An arc with an arrow at `last`; angles in degrees, counter-clockwise."""
    low, high = min(first, last), max(first, last)
    axis.add_patch(Arc(center, 2 * radius, 2 * radius, theta1=low, theta2=high, color=MOVED, lw=1.3))
    end, before = (np.deg2rad(last + k) for k in (0.0, -4.0 * np.sign(last - first)))
    points = [np.add(center, radius * np.array([np.cos(a), np.sin(a)])) for a in (before, end)]
    axis.annotate("", points[1], points[0], arrowprops={"arrowstyle": "-|>", "color": MOVED, "lw": 1.3})
    middle = np.deg2rad((first + last) / 2)
    place = np.add(center, radius * np.array([np.cos(middle), np.sin(middle)])) if at is None else at
    axis.text(*place, text, color=MOVED, ha="center", va="center")


def from_above(axis: Axes, views: gm.Geometry) -> None:
    """Source and panel at θ = 0 and turned, as the package places them."""
    axis.set_title("from above; z points towards you", color=QUIET)
    for k, colour in ((1, QUIET), (0, INK)):
        source, panel, step = (part[k][:2] for part in (views.source, views.detector, views.u))
        half = step * (SHAPE[1] - 1) / 2
        ends = np.array([panel - half, panel + half])
        axis.plot(*ends.T, color=colour, lw=3, solid_capstyle="butt")
        for end in ends:
            axis.plot(*np.array([source, end]).T, color=BEAM, lw=0.7, alpha=0.9 if k == 0 else 0.4)
        axis.plot(*source, "o", color=colour, ms=6)
        axis.text(*np.add(source, (-0.8, -0.4)), "source" if k == 0 else "", color=colour, ha="center", va="center")
        if k == 0:
            arrow(axis, ends[1], step * 2.2, "u", shift=(0.35, 0))
            axis.text(*(ends[0] + [0, 0.35]), "column 0", color=INK, ha="center", fontsize=9)
        place = panel * 1.2 + [1.4, 0] if k == 0 else panel - 1.3 * half
        axis.text(*place, "θ = 0" if k == 0 else f"θ = {TURNED_DEG:.0f}°", color=colour, ha="center", va="center")
    arrow(axis, np.zeros(2), np.array([1.7, 0]), "x", shift=(0.25, 0))
    arrow(axis, np.zeros(2), np.array([0, 1.7]), "y", shift=(0, 0.25))
    axis.add_patch(Polygon(0.45 * GRAIN + [0.95, -0.5], color=QUIET, alpha=0.5, lw=0))
    moving = "in the sample frame:\nsource and panel turn\ncounter-clockwise"
    turn(axis, (0, 0), SOURCE_TO_AXIS, -90, -90 + TURNED_DEG, moving, at=(2.9, -6.0))
    turn(axis, (0, 0), 1.25, -110, -160, "in the laboratory:\nthe stage turns\nclockwise", at=(-3.3, -1.5))
    axis.set_xlim(-5.2, 5.2)
    axis.set_ylim(-6.8, 4.4)


def from_the_side(axis: Axes, views: gm.Geometry) -> None:
    """θ = 0, seen from +x: y to the right, z up."""
    axis.set_title("from the side, θ = 0; x points towards you", color=QUIET)
    source, panel, step = (part[0][1:] for part in (views.source, views.detector, views.v))
    half = step * (SHAPE[0] - 1) / 2
    ends = np.array([panel - half, panel + half])
    axis.plot(*ends.T, color=INK, lw=3, solid_capstyle="butt")
    for end in ends:
        axis.plot(*np.array([source, end]).T, color=BEAM, lw=0.7)
    axis.plot(*source, "o", color=INK, ms=6)
    axis.text(source[0], source[1] + 0.4, "source", color=INK, ha="center")
    arrow(axis, ends[1], step * 2.2, "v", shift=(0, 0.3))
    axis.text(ends[0][0] + 0.25, ends[0][1], 'row 0 if first_row = "bottom"', color=INK, va="center", fontsize=9)
    axis.text(
        ends[1][0] + 0.25,
        ends[1][1],
        'row 0 if first_row = "top":\nv points down then',
        color=INK,
        va="center",
        fontsize=9,
    )
    axis.text(panel[0] + 0.25, 0, "d: centre of the panel", color=INK, va="center", fontsize=9)
    axis.plot(*panel, "+", color=INK, ms=9)
    arrow(axis, np.zeros(2), np.array([0, 1.7]), "z", shift=(0, 0.25))
    arrow(axis, np.zeros(2), np.array([1.7, 0]), "y", shift=(0.25, 0))
    axis.add_patch(Polygon(0.45 * GRAIN + [-0.3, -0.7], color=QUIET, alpha=0.5, lw=0))
    level = -2.6
    for k, (length, name) in enumerate(
        ((SOURCE_TO_AXIS, "source_to_axis"), (SOURCE_TO_DETECTOR, "source_to_detector"))
    ):
        y = level - 0.6 * k
        ends_of_length = ((source[0], y), (source[0] + length, y))
        axis.annotate("", ends_of_length[1], ends_of_length[0], arrowprops={"arrowstyle": "<->", "color": QUIET})
        axis.text(source[0] + length / 2, y + 0.2, name, color=QUIET, ha="center", fontsize=9)
    axis.set_xlim(-5.6, 7.2)
    axis.set_ylim(-3.5, 3.6)


def motion(axis: Axes) -> None:
    """x = Ω (X − c) + u + c."""
    axis.set_title("motion of a grain; ω points towards you", color=QUIET)
    c, u, angle = np.array([0.0, 0.0]), np.array([2.4, 1.1]), 40.0
    omega = rotation_matrix(np.array([0.0, 0.0, np.deg2rad(angle)]))[:2, :2]
    axis.add_patch(Polygon(GRAIN, facecolor=QUIET, alpha=0.4, lw=0))
    axis.add_patch(Polygon(GRAIN @ omega.T + u, facecolor=MOVED, alpha=0.35, lw=0))
    for center, matrix, colour, name in ((c, np.eye(2), INK, "X"), (c + u, omega, MOVED, "x")):
        point = matrix @ GRAIN[1] + center
        axis.plot(*np.array([center, point]).T, color=colour, lw=1)
        axis.plot(*point, "o", color=colour, ms=4)
        axis.text(*np.add(point, 0.14), name, color=colour, weight="bold")
    axis.plot(*c, "o", color=INK, ms=4)
    axis.text(-0.2, -0.25, "c", color=INK, weight="bold")
    arrow(axis, c, u, "u", shift=(-0.05, -0.25))
    start = np.rad2deg(np.arctan2(GRAIN[1][1], GRAIN[1][0]))
    axis.plot(*np.array([u, u + 0.8 * GRAIN[1]]).T, color=QUIET, lw=0.8, ls="--")
    turn(axis, tuple(u), 0.72, start, start + angle, "ω", at=np.add(u, (0.55, 0.85)))
    axis.text(1.2, -1.25, "x = Ω (X − c) + u + c", color=INK, ha="center", style="italic")
    axis.set_xlim(-1.2, 3.7)
    axis.set_ylim(-1.6, 2.6)


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_name("conventions.svg"))
