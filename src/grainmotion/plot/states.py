"""What happens to the grains over the states of a series."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.plot.canvas import LINE_COLOURS, axes_of, legend_beside, note
from grainmotion.sequences.series import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_LINES = 12
"""Grains up to which each has its own line; of more, median and range are drawn."""
FROM_REFERENCE = ("u", "ux", "uy", "uz", "w", "wx", "wy", "wz", "path", "rotation_path")
"""Values that are 0 in the reference, which is drawn as the first state."""


@checked_arguments
def history(series: Series, value: str = "u", *, labels: Sequence[int] | None = None, ax: Axes | None = None) -> Axes:
    """A value of the grains over the states of a series: a line a grain, of many grains median and range.

    Parameters
    ----------
    series : Series
        Motions of all states.
    value : str
        "u", length of the translation (mm), or "w", angle of the rotation (degrees), from the reference; or a column of
        ``series.to_table()``, such as "uz", "duz", "path", "rotation_path" or "residual".  Motions that are no results
        to use are left out.
    labels : sequence of int, optional
        The grains to draw, each as a line; all of them unless given.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        Over the time in seconds where that of each state is known, else over the states by name.

    Raises
    ------
    InputError
        If there is no such value, or no such grain.

    Examples
    --------
    >>> import grainmotion as gm
    >>> from dataclasses import replace
    >>> start = gm.Motions.identity([1, 2, 3], [[0, 0, 0], [1, 0, 2], [2, 1, 1]])
    >>> steps = [replace(start, translations=k * start.centers, statuses=["converged"] * 3) for k in (1, 2)]
    >>> ax = gm.plot.history(gm.Series.of({"step-01": steps[0], "step-02": steps[1]}), "uz")
    """
    values, name = _values(series, value)
    rows = np.arange(len(series.labels))
    if labels is not None:
        unknown = sorted(set(labels) - set(series.labels.tolist()))
        if unknown:
            raise InputError("labels", f"there is no grain {unknown[0]}", "give labels of series.labels")
        rows = np.array([int(np.flatnonzero(series.labels == label)[0]) for label in labels], dtype=np.int64)
    places, values = _places(series, values, from_reference=value in FROM_REFERENCE)
    ax = axes_of(ax, (6.6, 3.8))
    if labels is not None or len(rows) <= MAX_LINES:
        for k, row in enumerate(rows):
            colour, style = LINE_COLOURS[k % len(LINE_COLOURS)], ("-", "--", ":")[k // len(LINE_COLOURS) % 3]
            ax.plot(places, values[:, row], "o", ls=style, color=colour, ms=4, label=f"grain {series.labels[row]}")
        legend_beside(ax, "small")
    else:
        _draw_range(ax, places, values)
    if not np.isfinite(series.times).all():
        names = ("reference", *series.states) if value in FROM_REFERENCE else series.states
        ax.set_xticks(places, names, rotation=30 if len(names) > 4 else 0, ha="right" if len(names) > 4 else "center")
    else:
        ax.set_xlabel("time since the reference (s)")
    ax.set_ylabel(name)
    ax.grid(alpha=0.2)
    return ax


def _draw_range(ax: Axes, places: Float, values: Float) -> None:
    """Median over the grains, the range of 80 % of them, and thin lines of all."""
    lines = ax.plot(places, values, color="0.6", lw=0.5, alpha=max(0.08, min(0.5, 30 / values.shape[1])), zorder=1)
    lines[0].set_label("each grain")
    known = np.isfinite(values).any(axis=1)
    low, middle, high = np.nanquantile(values[known], [0.1, 0.5, 0.9], axis=1)
    ax.fill_between(places[known], low, high, color=LINE_COLOURS[0], alpha=0.25, label="80 % of the grains")
    ax.plot(places[known], middle, "o-", color=LINE_COLOURS[0], lw=2, ms=4, label="median")
    legend_beside(ax, "small")
    legend = ax.get_legend()
    if legend is not None:
        legend.get_lines()[0].set(alpha=1.0, linewidth=1.0)  # one grain's line is too pale to be seen
    note(ax, f"{values.shape[1]} grains")


def _values(series: Series, value: str) -> tuple[Float, str]:
    """Values ``(s, n)`` and their name with the unit."""
    translations, rotations = series.used_translations, np.rad2deg(series.used_rotations)
    if value in ("u", "w"):
        vectors = translations if value == "u" else rotations
        return np.linalg.norm(vectors, axis=2), "|u| (mm)" if value == "u" else "|ω| (°)"
    table = series.to_table()
    if value not in table.columns or value in ("state", "status", "reason", "label", "index", "time"):
        columns = [c for c in table.columns if c not in ("state", "status", "reason", "label", "index", "time")]
        raise InputError("value", f"there is no value '{value}'", f"use one of u, w, {', '.join(columns)}")
    values = table[value].to_numpy(float).reshape(len(series), -1)
    for k, axis in enumerate("xyz"):  # motions that are no results to use are NaN
        values = {f"u{axis}": translations[..., k], f"w{axis}": rotations[..., k]}.get(value, values)
    unit = table.attrs["units"].get(value, "1").replace("deg", "°")
    return values, value.replace("_", " ") if unit == "1" else f"{value.replace('_', ' ')} ({unit})"


def _places(series: Series, values: Float, *, from_reference: bool) -> tuple[Float, Float]:
    """Where the states are on the axis, and their values, with the reference before them where it has some."""
    timed = bool(np.isfinite(series.times).all())
    places = series.times if timed else np.arange(1, len(series) + 1, dtype=float)
    if not from_reference:
        return places, values
    return np.concatenate([[0.0], places]), np.concatenate([np.zeros_like(values[:1]), values])
