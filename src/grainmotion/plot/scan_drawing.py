"""A drawing of a scan from above: where source and panel stand in each view, and which way the sample turns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.diagnosis.hypotheses import stage_angles_deg
from grainmotion.model.geometry import Geometry
from grainmotion.plot.canvas import LINE_COLOURS, TEXT_SIZE, axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SOURCE_RADIUS, PANEL_RADIUS, PANEL_HALF_WIDTH = 3.0, 2.6, 1.5
"""Of the drawing, in radii of the sample."""
MAX_NUMBERED_VIEWS = 16
WHITE: Mapping[str, object] = MappingProxyType({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1})
"""Background of a text."""
TURN_COLOUR, VIEW_COLOUR, PANEL_COLOUR = LINE_COLOURS[1], LINE_COLOURS[0], "0.25"


@checked_arguments
def geometry(geometry: Geometry, *, ax: Axes | None = None) -> Axes:
    """A scan seen from above: source, rays and panel of view 0, the other views, and which way the sample turns.

    Nothing in the radiographs contradicts a wrong sense of rotation or rows that run the other way; compare the drawing
    with the scanner.

    Parameters
    ----------
    geometry : Geometry
        Views of a scan about the z axis.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        x to the right, y upwards, z towards the reader; not to scale, distances are in the title.

    Examples
    --------
    >>> import grainmotion as gm
    >>> ax = gm.plot.geometry(gm.Geometry.parallel([0, 45, 90, 135], (100, 120), 0.01))
    """
    from matplotlib.patches import Circle

    drawn = _Drawn(geometry)
    ax = axes_of(ax, (5.6, 6.0))
    ax.add_patch(Circle((0, 0), 1.0, facecolor="0.93", edgecolor="0.3", zorder=2))
    ax.plot(0, 0, "+", color="0.2", ms=9, zorder=3)
    ax.annotate("axis", (0, 0), (4, 3), textcoords="offset points", fontsize=TEXT_SIZE, color="0.2", zorder=4)
    _draw_views(ax, drawn)
    _draw_first_view(ax, drawn)
    if drawn.sense:
        _draw_sense(ax, drawn)
    _draw_frame(ax)
    ax.set_title(drawn.title, fontsize="medium")
    ax.text(0.5, 0.0, drawn.caption, transform=ax.transAxes, ha="center", va="top", fontsize=TEXT_SIZE)
    ax.set_xlim(-3.9, 3.9)
    ax.set_ylim(-3.9, 3.6)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return ax


@dataclass(frozen=True, eq=False)
class _Drawn:
    """What of a geometry is drawn; angles in the plane of the drawing are radians, counter-clockwise from x."""

    geometry: Geometry

    @property
    def towards_source(self) -> Float:
        """Directions from the axis to the source, ``(n,)``."""
        return np.arctan2(-self.geometry.rays[:, 1], -self.geometry.rays[:, 0])

    @property
    def along_columns(self) -> Float:
        """Direction of rising columns on the panel of view 0, ``(2,)``, of length 1."""
        u = self.geometry.u[0, :2]
        return u / max(float(np.linalg.norm(u)), 1e-300)

    @property
    def sense(self) -> int:
        """1 if source and panel go counter-clockwise about the sample from view to view, −1 if clockwise, else 0."""
        steps = np.diff(stage_angles_deg(self.geometry))
        return int(np.sign(np.median(steps))) if len(steps) else 0

    @property
    def title(self) -> str:
        """Beam, number of views, distances and size of the field of view."""
        g = self.geometry
        views = f"{len(g)} view{'s' if len(g) != 1 else ''}"
        pixel = g.pixel_at(np.zeros(3))
        first = f"{g.beam} beam, {views} of {g.shape[0]} × {g.shape[1]} pixels, {pixel:.3g} mm at the axis"
        if g.beam == "parallel":
            return first
        normal = g.normals[0] / np.linalg.norm(g.normals[0])
        to_axis, to_panel = abs(float(g.source[0] @ normal)), abs(float(g.rays[0] @ normal))
        return f"{first}\nsource to axis {to_axis:.4g} mm, to panel {to_panel:.4g} mm"

    @property
    def caption(self) -> str:
        """How to tell on the scanner whether the drawing is right."""
        row = "lowest" if float(self.geometry.v[:, 2].mean()) >= 0 else "highest"
        text = f"seen from above, not to scale; row 0 of the images is the {row}"
        if not self.sense:
            return text
        side = "left" if self.sense > 0 else "right"
        return f"{text}\nseen from the source, the front of the sample moves to the {side}"


def _at(angle: float, radius: float) -> Float:
    return radius * np.array([np.cos(angle), np.sin(angle)])


def _text(ax: Axes, place: Float, text: str, colour: str) -> None:
    """A small text in the middle of a place, on white so that points behind it do not cross it."""
    ax.text(
        float(place[0]), float(place[1]), text, fontsize=TEXT_SIZE, color=colour, ha="center", va="center",
        bbox=dict(WHITE), zorder=6,
    )  # fmt: skip


def _draw_views(ax: Axes, drawn: _Drawn) -> None:
    """A point for the source in each view on a circle about the sample; numbers and central rays if views are few."""
    angles = drawn.towards_source
    places = np.stack([np.cos(angles), np.sin(angles)], axis=1) * SOURCE_RADIUS
    few = len(angles) <= MAX_NUMBERED_VIEWS
    ax.plot(*places.T, "o" if few else ".", color=VIEW_COLOUR, ms=5 if few else 2.5, zorder=3)
    if not few:
        return
    for view, angle in enumerate(angles):
        ax.plot(*np.stack([_at(angle, SOURCE_RADIUS), _at(angle, 1.05)]).T, color=VIEW_COLOUR, lw=0.5, alpha=0.5)
        name = f"{view}: {drawn.geometry.azimuths_deg[view]:.4g}°"
        _text(ax, _at(angle, SOURCE_RADIUS + 0.45), name, VIEW_COLOUR)


def _draw_first_view(ax: Axes, drawn: _Drawn) -> None:
    """Source, outer rays and panel of view 0, with the ends of its columns."""
    angle, columns = float(drawn.towards_source[0]), drawn.along_columns
    source, middle = _at(angle, SOURCE_RADIUS), _at(angle + np.pi, PANEL_RADIUS)
    ends = [middle - PANEL_HALF_WIDTH * columns, middle + PANEL_HALF_WIDTH * columns]
    for end in ends:
        start = source if drawn.geometry.beam == "cone" else end + (source - middle)
        ax.plot(*np.stack([start, end]).T, color=VIEW_COLOUR, lw=0.9, alpha=0.8, zorder=1)
        tip = start + 0.3 * (end - start)
        arrow = {"arrowstyle": "-|>", "color": VIEW_COLOUR, "lw": 0.9}
        ax.annotate("", (tip[0], tip[1]), (start[0], start[1]), arrowprops=arrow, zorder=1)
    ax.plot(*np.stack(ends).T, color=PANEL_COLOUR, lw=4, solid_capstyle="butt", zorder=3)
    outwards = _at(angle + np.pi, 0.28)
    for end, name in zip(ends, ("column 0", f"{drawn.geometry.shape[1] - 1}"), strict=True):
        _text(ax, end + outwards, name, PANEL_COLOUR)
    _text(ax, middle + outwards, "panel", PANEL_COLOUR)
    name = "source, view 0" if drawn.geometry.beam == "cone" else "beam, view 0"
    ax.plot(*source, "o", color=VIEW_COLOUR, ms=9, zorder=4)
    side = np.array([-np.sin(angle), np.cos(angle)])
    x, y = source + 0.3 * (side if side[0] >= 0 else -side)
    ax.text(
        x,
        y,
        name,
        fontsize=TEXT_SIZE,
        color=VIEW_COLOUR,
        va="center",
        bbox=dict(WHITE),
        zorder=6,
        ha="left" if abs(side[0]) > 0.3 else "center",
    )


def _draw_sense(ax: Axes, drawn: _Drawn) -> None:
    """An arrow on the sample: the way in which the stage turns, which is against that of the source in this frame."""
    from matplotlib.patches import FancyArrowPatch

    front = float(drawn.towards_source[0])
    start, end = _at(front, 0.72), _at(front - drawn.sense * np.pi / 2, 0.72)
    bend = 0.5 * drawn.sense  # a quarter circle
    arrow = FancyArrowPatch(
        tuple(start), tuple(end), connectionstyle=f"arc3,rad={-bend}", arrowstyle="-|>", mutation_scale=16,
        color=TURN_COLOUR, lw=2.2, zorder=5, shrinkA=0, shrinkB=0,
    )  # fmt: skip
    ax.add_patch(arrow)
    ax.plot(*start, "o", color=TURN_COLOUR, ms=5, zorder=5)
    word = "clockwise" if drawn.sense > 0 else "counter-clockwise"
    ax.text(
        0,
        1.12,
        f"sample turns {word}",
        color=TURN_COLOUR,
        ha="center",
        va="bottom",
        weight="bold",
        bbox=dict(WHITE),
        zorder=6,
    )


def _draw_frame(ax: Axes) -> None:
    """Directions of x and y in the corner."""
    corner = (-3.7, -3.7)
    for right, up, name in ((0.8, 0.0, "x"), (0.0, 0.8, "y")):
        tip = (corner[0] + right, corner[1] + up)
        ax.annotate("", tip, corner, arrowprops={"arrowstyle": "->", "color": "0.3"})
        _text(ax, np.array([corner[0] + 1.2 * right, corner[1] + 1.2 * up]), name, "0.3")
