"""The figure of a plan: predicted precision by number of views, and by angles of two views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from grainmotion.planning.plan import Plan
from grainmotion.plot.plans import plan_pairs, plan_precision

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

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
        plan_precision(plan, ax=left)
        plan_precision(plan, rotation=True, ax=middle)
        plan_pairs(plan, ax=right)
        text = f"Predicted for {len(plan.labels)} grains, {plan.settings.photons:,.0f} photons a pixel"
        figure.suptitle(f"{text}: median, and 10 to 90 % of the grains", fontsize=11)
    return figure
