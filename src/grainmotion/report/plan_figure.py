"""The figure of a plan: predicted precision by number of views, and by angles of two views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, MaxNLocator, MultipleLocator

from grainmotion.planning.plan import Plan
from grainmotion.report.figure_colours import LINE_COLOURS

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

VIEW_SET_KINDS = {
    "best": ("best angles", LINE_COLOURS[0], "o", -0.06),
    "even": ("even over 180°", LINE_COLOURS[1], "s", 0.06),
}
"""Label, colour, marker and horizontal shift of each kind of set of views."""
PLAN_STYLE: dict[RcKeyType, object] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.5,
}


def plan_figure(plan: Plan) -> Figure:
    """Predicted sd of translation and rotation by number of views, and the criterion of all pairs of views."""
    with matplotlib.rc_context(PLAN_STYLE):
        figure = Figure(figsize=(13.5, 4.3), layout="constrained")
        FigureCanvasAgg(figure)
        left, middle, right = figure.subplots(1, 3, width_ratios=[1, 1, 1.25])
        _precision(left, plan, rotation=False)
        left.set_title("sd of a component of u, voxels")
        left.legend(frameon=False)
        _precision(middle, plan, rotation=True)
        middle.set_title("sd of a component of ω, degrees")
        _pairs(figure, right, plan)
        text = f"Predicted for {len(plan.labels)} grains, {plan.settings.photons:,.0f} photons a pixel"
        figure.suptitle(f"{text}: median, and 10 to 90 % of the grains", fontsize=11)
    return figure


def _precision(axes: Axes, plan: Plan, *, rotation: bool) -> None:
    """Median over the grains with the range that holds 80 % of them, a line a kind of set of views."""
    for kind, (label, colour, marker, shift) in VIEW_SET_KINDS.items():
        sets = [s for s in plan.sets if s.kind == kind]
        if not sets:
            continue
        sd = [s.sd_rotation_deg if rotation else s.sd_translation / plan.voxel_size for s in sets]
        low, middle, high = np.maximum(np.percentile(sd, [10, 50, 90], axis=1), 1e-9)
        positions = np.array([len(s) for s in sets]) + shift
        axes.errorbar(
            positions, middle, (middle - low, high - middle), color=colour, marker=marker, ms=5, lw=1.6, capsize=3,
            label=label,
        )  # fmt: skip
    axes.set_xlabel("number of views")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    low, high = axes.get_ylim()
    if high > 10 * max(low, 1e-9):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    else:
        axes.set_ylim(0, high)
    axes.grid(alpha=0.25)


def _pairs(figure: Figure, axes: Axes, plan: Plan) -> None:
    """The criterion of every pair of candidate angles, voxels, with the best and the even pair."""
    order = np.argsort(plan.angles_deg)
    angles, values = plan.angles_deg[order], plan.pairs[np.ix_(order, order)] / plan.voxel_size
    top = min(values.max(), 3 * values.min())  # worse pairs all have one colour
    image = axes.pcolormesh(angles, angles, values, cmap="viridis_r", vmax=top, shading="nearest", rasterized=True)
    bar = figure.colorbar(image, ax=axes, extend="max" if top < values.max() else "neither")
    bar.set_label("voxels")
    for kind, (label, colour, marker, _) in VIEW_SET_KINDS.items():
        pair = next((s for s in plan.sets if s.kind == kind and len(s) == 2), None)
        if pair is not None:
            a, b = sorted(pair.angles_deg)
            axes.plot(a, b, marker, color=colour, ms=9, mec="white", mew=1.5, ls="none", label=label, clip_on=False)
    step = 90 if np.ptp(angles) > 200 else 45 if np.ptp(angles) > 60 else 15
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    axes.set_aspect("equal")
    axes.set_xlabel("angle of one view, degrees")
    axes.set_ylabel("angle of the other")
    axes.set_title("two views: sd of the grains' surfaces")
