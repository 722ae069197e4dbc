"""The precision to expect of planned views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.planning.plan import Plan
from grainmotion.plot.canvas import LINE_COLOURS, axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VIEW_SET_KINDS = {
    "best": ("best angles", LINE_COLOURS[0], "o", -0.06),
    "even": ("even over 180°", LINE_COLOURS[1], "s", 0.06),
}
"""Label, colour, marker and horizontal shift of each kind of set of views."""


@checked_arguments
def plan_precision(plan: Plan, *, rotation: bool = False, ax: Axes | None = None) -> Axes:
    """Predicted standard deviation by number of views: median over the grains with the range that holds 80 % of them.

    Parameters
    ----------
    plan : Plan
        Of `grainmotion.plan`.
    rotation : bool
        Of the rotation vector, degrees, in place of the translation, voxels.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        A line for the best angles, and one for evenly spread ones.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> labels = np.zeros((12, 14, 24), int)
    >>> labels[3:9, 4:10, 3:10], labels[3:8, 3:10, 13:20] = 1, 2
    >>> grains = gm.grains_from_labels(gm.Volume(0.5 * (labels > 0), voxel_size=0.1), labels, finer=1)
    >>> views = gm.Geometry.parallel(np.arange(0, 180, 15), (24, 36), 0.1)
    >>> found = gm.plan(grains, views, gm.PlanSettings(views=(2, 3)))
    >>> ax = gm.plot.plan_precision(found, rotation=True)
    """
    from matplotlib.ticker import FormatStrFormatter, MaxNLocator

    ax = axes_of(ax, (5.2, 4.0))
    for kind, (label, colour, marker, shift) in VIEW_SET_KINDS.items():
        sets = [s for s in plan.sets if s.kind == kind]
        if not sets:
            continue
        sd = [s.sd_rotation_deg if rotation else s.sd_translation / plan.voxel_size for s in sets]
        low, middle, high = np.maximum(np.percentile(sd, [10, 50, 90], axis=1), 1e-9)
        positions = np.array([len(s) for s in sets]) + shift
        ax.errorbar(
            positions, middle, (middle - low, high - middle), color=colour, marker=marker, ms=5, lw=1.6, capsize=3,
            label=label,
        )  # fmt: skip
    ax.set_xlabel("number of views")
    ax.set_ylabel("sd of a component of ω (°)" if rotation else "sd of a component of u (voxel)")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    low, high = ax.get_ylim()
    if high > 10 * max(low, 1e-9):
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    else:
        ax.set_ylim(0, high)
    ax.grid(alpha=0.25)
    ax.legend(frameon=False)
    return ax


@checked_arguments
def plan_pairs(plan: Plan, *, ax: Axes | None = None) -> Axes:
    """The criterion of every pair of candidate angles, with the best and the even pair.

    Parameters
    ----------
    plan : Plan
        Of `grainmotion.plan`.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        Standard deviation of the grains' surfaces, voxels, over the angles of two views, degrees.

    Raises
    ------
    InputError
        If the plan has one candidate view only.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> labels = np.zeros((12, 14, 24), int)
    >>> labels[3:9, 4:10, 3:10], labels[3:8, 3:10, 13:20] = 1, 2
    >>> grains = gm.grains_from_labels(gm.Volume(0.5 * (labels > 0), voxel_size=0.1), labels, finer=1)
    >>> views = gm.Geometry.parallel(np.arange(0, 180, 15), (24, 36), 0.1)
    >>> ax = gm.plot.plan_pairs(gm.plan(grains, views, gm.PlanSettings(views=(2,))))
    """
    from matplotlib.ticker import MultipleLocator

    if len(plan.angles_deg) < 2:
        raise InputError("plan", "it has one candidate view", "plan with more candidates")
    ax = axes_of(ax, (5.4, 4.4))
    order = np.argsort(plan.angles_deg)
    angles, values = plan.angles_deg[order], plan.pairs[np.ix_(order, order)] / plan.voxel_size
    top = min(values.max(), 3 * values.min())  # worse pairs all have one colour
    image = ax.pcolormesh(angles, angles, values, cmap="viridis_r", vmax=top, shading="nearest", rasterized=True)
    bar = ax.figure.colorbar(image, ax=ax, extend="max" if top < values.max() else "neither")
    bar.set_label("sd of the grains' surfaces (voxel)")
    for kind, (label, colour, marker, _) in VIEW_SET_KINDS.items():
        pair = next((s for s in plan.sets if s.kind == kind and len(s) == 2), None)
        if pair is not None:
            a, b = sorted(pair.angles_deg)
            ax.plot(a, b, marker, color=colour, ms=9, mec="white", mew=1.5, ls="none", label=label, clip_on=False)
    step = 90 if np.ptp(angles) > 200 else 45 if np.ptp(angles) > 60 else 15
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    ax.set_aspect("equal")
    ax.set_xlabel("angle of one view (°)")
    ax.set_ylabel("angle of the other (°)")
    return ax
