"""How the fit of a state went: its convergence, gain and offset by view, and corrections of the views."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.state_fit import StateFit
from grainmotion.plot.canvas import LINE_COLOURS, axes_of, legend_beside

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIT_SIZE = (6.4, 3.6)


@checked_arguments
def convergence(fit: Motions | StateFit | Sequence[float], *, ax: Axes | None = None) -> Axes:
    """Relative residual by iteration, a colour for each stage of the fit; logarithmic.

    Stages filter the radiographs by different widths, so that their residuals do not compare with each other.

    Parameters
    ----------
    fit : Motions, StateFit or sequence of float
        Motions of a state, their ``fit``, or the residuals of a reconstruction (``reference.residuals``).
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        One line a stage.

    Raises
    ------
    InputError
        If no residuals are known, as of motions read from a CSV.

    Examples
    --------
    >>> import grainmotion as gm
    >>> ax = gm.plot.convergence(gm.StateFit(costs=(("whole sample", 0.5), ("all grains", 0.1), ("all grains", 0.05))))
    >>> ax = gm.plot.convergence([0.3, 0.1, 0.05])
    """
    from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

    stages = _stages(fit)
    if not any(len(values) for _, _, values in stages):
        fact = "no residuals are known"
        raise InputError("fit", fact, "give motions of gm.track or of a results folder; a CSV does not hold them")
    ax = axes_of(ax, FIT_SIZE)
    for k, (name, first, values) in enumerate(stages):
        shown = np.where(values > 0, values, np.nan)
        ax.semilogy(
            np.arange(first, first + len(values)), shown, "o-", color=LINE_COLOURS[k % len(LINE_COLOURS)], ms=3.5,
            lw=1.6, label=name,
        )  # fmt: skip
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    low, high = ax.get_ylim()
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
    ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("iteration")
    ax.set_ylabel("relative residual")
    ax.grid(alpha=0.2)
    legend_beside(ax, "small")
    return ax


@checked_arguments
def gains(fit: Motions | StateFit, *, ax: Axes | None = None) -> Axes:
    """Gain of each view, measured ≈ gain · simulated + offset, less one; and the offset.

    Parameters
    ----------
    fit : Motions or StateFit
        Motions of a state, or their ``fit``.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        Bars a view: gain − 1 and offset, both line-integral units for a line integral of 1.

    Examples
    --------
    >>> import grainmotion as gm
    >>> ax = gm.plot.gains(gm.StateFit(gain=1.01, offset=-0.002))
    """
    state = fit.fit if isinstance(fit, Motions) else fit
    gain, offset = np.array([state.gain]), np.array([state.offset])
    if state.response is not None:
        gain = state.response.polynomial[:, 0]
        background = state.response.background
        offset = background[:, 0] if background.shape[1] else np.zeros(len(gain))
    ax = axes_of(ax, FIT_SIZE)
    views = np.arange(len(gain))
    ax.bar(views - 0.2, gain - 1, 0.4, color=LINE_COLOURS[0], label="gain − 1")
    ax.bar(views + 0.2, offset, 0.4, color=LINE_COLOURS[1], label="offset")
    ax.axhline(0, color="0.4", lw=0.8)
    if state.response is None:
        ax.set_xticks([0], ["all views"])
    else:
        _name_views(ax, len(gain))
    ax.set_ylabel("gain − 1, offset")
    legend_beside(ax)
    return ax


@checked_arguments
def view_corrections(
    fit: Motions | StateFit, *, quantity: Literal["shift", "angle"] = "shift", ax: Axes | None = None
) -> Axes:
    """Corrections of the views that were estimated with the motions, with their standard deviations.

    Parameters
    ----------
    fit : Motions or StateFit
        Motions of a state, or their ``fit``.
    quantity : {"shift", "angle"}
        Shifts of the panel along u (columns) and v (rows), pixels; or the excess rotation of the stage, degrees.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        One point a view, with error bars of one standard deviation.

    Raises
    ------
    InputError
        If no corrections were estimated, or the quantity is unknown.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> from grainmotion.model.pose import ViewCorrections
    >>> shifts = ViewCorrections(np.array([[0.2, 0.0], [-0.1, 0.1]]), np.zeros(2))
    >>> ax = gm.plot.view_corrections(gm.StateFit(view_corrections=shifts))
    """
    state = fit.fit if isinstance(fit, Motions) else fit
    if state.view_corrections is None:
        raise InputError("fit", "no corrections of views were estimated", 'track with view_corrections="always"')
    if quantity not in ("shift", "angle"):
        raise InputError("quantity", f"'{quantity}' is unknown", 'use "shift" or "angle"')
    known, sd = state.view_corrections, state.view_corrections_sd
    if quantity == "shift":
        lines = {
            f"along {name}": (known.shifts_pixels[:, k], None if sd is None else sd.shifts_pixels[:, k])
            for k, name in enumerate(("u, columns", "v, rows"))
        }
    else:
        lines = {"angle": (np.rad2deg(known.angles), None if sd is None else np.rad2deg(sd.angles))}
    ax = axes_of(ax, FIT_SIZE)
    ax.axhline(0, color="0.4", lw=0.8)
    for k, (name, (values, errors)) in enumerate(lines.items()):
        places = np.arange(len(values)) + 0.12 * (k - (len(lines) - 1) / 2)
        ax.errorbar(places, values, errors, fmt="os"[k], ms=5, capsize=3, color=LINE_COLOURS[k], label=name)
    _name_views(ax, len(known.angles))
    ax.set_ylabel("shift of the panel (pixel)" if quantity == "shift" else "excess rotation of the stage (°)")
    ax.grid(alpha=0.2, axis="y")
    if len(lines) > 1:
        legend_beside(ax)
    return ax


def _stages(fit: Motions | StateFit | Sequence[float]) -> list[tuple[str, int, Float]]:
    """Name, first iteration and residuals of each stage."""
    if not isinstance(fit, Motions | StateFit):
        return [("", 1, np.asarray(fit, dtype=float))]
    costs = fit.fit.costs if isinstance(fit, Motions) else fit.costs
    starts = [k for k in range(len(costs)) if k == 0 or costs[k][0] != costs[k - 1][0]]
    ends = [*starts[1:], len(costs)]
    return [(costs[a][0], a + 1, np.array([c for _, c in costs[a:b]], dtype=float)) for a, b in zip(starts, ends)]


def _name_views(ax: Axes, count: int) -> None:
    ax.set_xlabel("view")
    if count <= 20:
        ax.set_xticks(range(count))
