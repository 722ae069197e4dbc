"""The figure of an inspection: which way is up, and which way the sample turns, as the experiment file says.

No radiograph tells these two, and a wrong one gives a mirror image of the sample that fits as well.  So the figure
shows the first radiographs with +z upwards, and where a point that is nearest the source in view 0 goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Rectangle

from grainmotion._typing import Float
from grainmotion.diagnosis.hypotheses import seen_from_behind, stage_angles_deg
from grainmotion.experiment.inspection import FirstViews
from grainmotion.io.files import atomic_write
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.plot.canvas import LINE_COLOURS
from grainmotion.report.grey_scale import grey_scale

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

DOTS_PER_INCH = 110
MAX_DRAWN_PIXELS = 400
"""Rows or columns from which a radiograph is drawn from every second, third, ... pixel."""
CAPTION = (
    "As the files have it: +z is up, and the orange point, nearest the source in view 0, moves as shown.  "
    "Compare with the stage and the sample."
)
POINT_COLOUR, AXIS_COLOUR = LINE_COLOURS[1], LINE_COLOURS[0]
INSPECTION_STYLE: dict[RcKeyType, object] = {"font.size": 9, "axes.titlesize": 9}


@dataclass(frozen=True, eq=False)
class DrawnScan:
    """The views of a scan that are drawn, and a point of the sample that is followed from view to view."""

    first: FirstViews
    grid: Volume

    @property
    def scan(self) -> Scan:
        """The views that are drawn."""
        return self.first.scan

    @property
    def name(self) -> str:
        """Name of the scan."""
        return self.first.name

    @cached_property
    def points(self) -> Float:
        """Rows and columns ``(views, 3, 2)``: the point nearest the source in view 0, top and bottom of the axis."""
        geometry, grid = self.scan.geometry, self.grid
        towards = -geometry.rays[0] * np.array([1.0, 1.0, 0.0])
        radius, height = grid.voxel_size * np.array([min(grid.shape[1:]), grid.shape[0]]) / 2
        near = np.array(grid.center) * [0, 0, 1] + 0.6 * radius * towards / max(float(np.linalg.norm(towards)), 1e-12)
        ends = [np.array([0.0, 0.0, grid.center[2] + sign * height]) for sign in (1, -1)]
        return geometry.project_points(np.stack([near, *ends]))

    @property
    def moves_right(self) -> bool | None:
        """Whether the point moves to higher columns after view 0; None if it does not move."""
        columns = self.points[:, 0, 1]
        angles = stage_angles_deg(self.scan.geometry)
        moved = np.flatnonzero((np.abs(angles - angles[0]) > 1e-3) & (np.abs(angles - angles[0]) < 90))
        if not len(moved):
            return None
        change = float(columns[moved[0]] - columns[0])
        return None if not np.isfinite(change) or abs(change) < 1e-9 else change > 0

    @property
    def behind(self) -> bool:
        """Whether the images show the panel from behind, as it is not drawn from above."""
        return seen_from_behind(self.scan.geometry)

    @property
    def angles_deg(self) -> Float:
        """Angles of the views as the experiment file counts them."""
        return stage_angles_deg(self.scan.geometry) + 180.0 * self.behind

    @property
    def sentence(self) -> str:
        """Which way is up and which way the sample turns, for a reader who can look at the stage."""
        up = "row 0 is the lowest" if self.upright else "row 0 is the highest"
        if self.moves_right is None:
            return f"{self.name}: {up} row"
        side = "right" if self.moves_right else "left"
        sense = "clockwise" if self.moves_right == self.behind else "counter-clockwise"
        place = (
            "the images show the panel from behind; the source's side"
            if self.behind
            else "with the source in front, the front"
        )
        return (
            f"{self.name}: {up} row; {place} of the sample moves to the {side} after "
            f"view 0 (seen from above it turns {sense})"
        )

    @property
    def upright(self) -> bool:
        """Whether row 0 is the lowest row."""
        return float(self.scan.geometry.v[:, 2].mean()) >= 0


def orientation(scans: Sequence[FirstViews], grid: Volume) -> tuple[str, ...]:
    """Which way is up and which way the sample turns, a sentence a scan."""
    return tuple(DrawnScan(first, grid).sentence for first in scans)


def write_inspection_figure(path: Path, scans: Sequence[FirstViews], grid: Volume) -> None:
    """Write the figure as a PNG."""
    figure = inspection_figure(scans, grid)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DOTS_PER_INCH)


def inspection_figure(scans: Sequence[FirstViews], grid: Volume) -> Figure:
    """One row a scan: its set-up seen from above, and radiographs with +z upwards and a point that is followed.

    Parameters
    ----------
    scans : sequence of FirstViews
        Radiographs to draw.
    grid : Volume
        Where the sample is.

    Returns
    -------
    Figure
        To be saved as a PNG.
    """
    drawn = [DrawnScan(first, grid) for first in scans]
    columns = 1 + max(len(d.scan) for d in drawn)
    with matplotlib.rc_context(INSPECTION_STYLE):
        figure = Figure(figsize=(2.7 * columns, 3.1 * len(drawn)), layout="constrained")
        FigureCanvasAgg(figure)
        for d, axes in zip(drawn, figure.subplots(len(drawn), columns, squeeze=False)):
            _draw_setup(axes[0], d)
            scale = grey_scale(d.scan.line_integrals)
            for view, panel in enumerate(axes[1:]):
                if view < len(d.scan):
                    _draw_radiograph(panel, d, view, (scale.low, scale.high))
                else:
                    panel.set_axis_off()
        figure.suptitle(CAPTION, fontsize=10)
    return figure


def _draw_radiograph(axes: Axes, drawn: DrawnScan, view: int, limits: tuple[float, float]) -> None:
    """One radiograph, +z upwards, with the axis, the point that is followed and where it goes next."""
    image = drawn.scan.line_integrals[view]
    rows, columns = image.shape
    step = max(1, -(-max(rows, columns) // MAX_DRAWN_PIXELS))
    bottom, top = (-0.5, rows - 0.5) if drawn.upright else (rows - 0.5, -0.5)
    axes.imshow(
        image[::step, ::step], cmap="gray", vmin=limits[0], vmax=limits[1],
        extent=(-0.5, columns - 0.5, bottom, top), origin="lower" if drawn.upright else "upper",
    )  # fmt: skip
    point, *ends = drawn.points[view]
    axes.plot([e[1] for e in ends], [e[0] for e in ends], "--", color=AXIS_COLOUR, lw=1)
    if np.isfinite(drawn.points[view : view + 2, 0]).all() and view + 1 < len(drawn.points):
        goal = drawn.points[view + 1, 0]
        axes.annotate("", goal[::-1], point[::-1], arrowprops={"arrowstyle": "->", "color": POINT_COLOUR, "lw": 1.5})
    axes.plot(point[1], point[0], "o", color=POINT_COLOUR, ms=5, mec="white", mew=0.8)
    axes.set_xlim(-0.5, columns - 0.5)
    axes.set_ylim(bottom, top)
    axes.set_title(f"view {drawn.first.views[view]}, {drawn.angles_deg[view]:.1f}°")
    top_of_axis = ends[0][1]
    if -0.5 <= top_of_axis <= columns - 0.5:
        axes.annotate("axis", (top_of_axis, top), (3, -3), textcoords="offset points", color=AXIS_COLOUR, va="top")
    axes.set_xticks([0, columns - 1], ["column 0", str(columns - 1)])
    axes.set_yticks([0, rows - 1], ["row 0", str(rows - 1)])
    axes.annotate("z", (0.06, 0.94), (0.06, 0.72), "axes fraction", color="white", ha="center", va="center",
                  arrowprops={"arrowstyle": "->", "color": "white"})  # fmt: skip


def _draw_setup(axes: Axes, drawn: DrawnScan) -> None:
    """Source, sample and panel seen from above in view 0, with the sense of rotation; not to scale.

    As they stand, whichever side the images show: column 0 is drawn at the right where they are from behind.
    """
    geometry = drawn.scan.geometry
    cone = geometry.beam == "cone"
    if cone:
        axes.plot(0, -2.2, "o", color="black", ms=6)
        axes.text(0.15, -2.2, " source", va="center")
        for x in (-1.0, 1.0):
            axes.plot([0, 1.35 * x], [-2.2, 1.8], color="0.7", lw=0.8)
    else:
        for x in (-0.8, 0.0, 0.8):
            axes.annotate("", (x, -1.2), (x, -2.3), arrowprops={"arrowstyle": "->", "color": "0.4"})
        axes.text(0, -2.5, "beam", ha="center")
    axes.add_patch(Rectangle((-1.5, 1.8), 3.0, 0.12, color="0.3"))
    left, right = ("column 0", str(geometry.shape[1] - 1))[:: -1 if drawn.behind else 1]
    axes.text(-1.5, 2.05, left, ha="left", fontsize=7.5)
    axes.text(1.5, 2.05, right, ha="right", fontsize=7.5)
    axes.text(0, 2.05, "panel", ha="center", fontsize=7.5)
    axes.text(0.86, 0.25, "sample", fontsize=7.5)
    axes.add_patch(Circle((0, 0), 0.8, fill=False, color="black"))
    axes.plot(0, 0, "+", color=AXIS_COLOUR, ms=8)
    axes.plot(0, -0.5, "o", color=POINT_COLOUR, ms=5)
    if drawn.moves_right is not None:
        sign = 1 if drawn.moves_right != drawn.behind else -1
        arrow = {"arrowstyle": "->", "color": POINT_COLOUR, "lw": 1.6, "connectionstyle": f"arc3,rad={0.3 * sign}"}
        axes.annotate("", (sign * 0.48, -0.12), (0, -0.5), arrowprops=arrow)
        axes.add_patch(Arc((0, 0), 1.0, 1.0, theta1=0, theta2=360, color=POINT_COLOUR, lw=0.6, ls=":"))
    seen = "\nimages show the panel from behind" if drawn.behind else ""
    axes.set_title(f"{drawn.name}, from above\n{_distances(geometry)}{seen}", fontsize=8)
    axes.text(0, -2.9, "not to scale", ha="center", fontsize=7.5, color="0.4")
    axes.set_xlim(-1.9, 1.9)
    axes.set_ylim(-2.9, 2.5)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _distances(geometry: Geometry) -> str:
    """Distances from the source in view 0, mm, across the panel."""
    if geometry.beam == "parallel":
        return "parallel beam"
    normal = geometry.normals[0] / np.linalg.norm(geometry.normals[0])
    source, panel = abs(float(geometry.source[0] @ normal)), abs(float(geometry.rays[0] @ normal))
    return f"source to axis {source:.4g}, to panel {panel:.4g} mm"
