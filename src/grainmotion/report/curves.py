"""Curves as SVG inside the page; text and axes take the page's text colour."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter

from grainmotion._typing import Float

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType  # of matplotlib 3.10 and later

TEXT_COLOUR = "#010203"  # replaced by the page's text colour
LINE_COLOURS = ("#2f7ed8", "#d9722e", "#2a9d68", "#b8478f", "#8a6d1f", "#5b6ee1", "#c0392b", "#16909b")
SVG_STYLE: dict[RcKeyType, object] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "grainmotion",
    "font.size": 10,
    "text.color": TEXT_COLOUR,
    "axes.labelcolor": TEXT_COLOUR,
    "axes.edgecolor": TEXT_COLOUR,
    "xtick.color": TEXT_COLOUR,
    "ytick.color": TEXT_COLOUR,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": TEXT_COLOUR,
    "grid.alpha": 0.15,
    "text.parse_math": False,
}


def convergence_svg(costs: Sequence[tuple[str, float]]) -> str:
    """Relative residual of the fit by iteration, a colour a stage, logarithmic."""
    title = "Convergence of the fit: relative residual by iteration"
    values = np.array([cost for _, cost in costs], dtype=float)
    return _svg(values, _stages(costs), "relative residual ‖b − aP − b₀‖/‖b‖", title)


def reconstruction_svg(errors: Sequence[float]) -> str:
    """Relative residual ε of the reconstruction by iteration, logarithmic."""
    title = "Convergence of the reconstruction: relative residual by iteration"
    values = np.asarray(errors, dtype=float)
    return _svg(values, [("", 0, len(values))], "relative residual ε = ‖b − Ax‖/‖b‖", title)


def _svg(values: Float, parts: Sequence[tuple[str, int, int]], y_label: str, title: str) -> str:
    """A curve in parts, each with its name, first and one-past-last iteration, as an ``<svg>`` element."""
    with matplotlib.rc_context(SVG_STYLE):
        figure = Figure(figsize=(6.4, 3.0), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.add_subplot()
        iterations = np.arange(1, len(values) + 1)
        for k, (name, first, last) in enumerate(parts):
            colour, part = LINE_COLOURS[k % len(LINE_COLOURS)], slice(first, last)
            axes.plot(iterations[part], _drawable(values)[part], color=colour, marker="o", ms=3.5, lw=1.8, label=name)
        axes.set_xlabel("iteration")
        axes.set_ylabel(y_label)
        _set_scales(axes, values)
        if any(name for name, _, _ in parts):
            legend = axes.legend(frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=(1.01, 1.0))
            for text in legend.get_texts():
                text.set_parse_math(False)
        return _element(figure, title)


def _stages(costs: Sequence[tuple[str, float]]) -> list[tuple[str, int, int]]:
    """Name, first and one-past-last iteration of each stage."""
    starts = [i for i in range(len(costs)) if i == 0 or costs[i][0] != costs[i - 1][0]]
    ends = [*starts[1:], len(costs)]
    return [(costs[a][0], a, b) for a, b in zip(starts, ends)]


def _drawable(values: Float) -> Float:
    """The values, NaN where a logarithmic axis cannot show them."""
    return np.where(np.isfinite(values) & (values > 0), values, np.nan)


def _set_scales(axes: Axes, values: Float) -> None:
    positive = _drawable(values)
    positive = positive[np.isfinite(positive)]
    if positive.size:
        axes.set_yscale("log")
        if positive.max() < 1.3 * positive.min():
            middle = np.sqrt(positive.max() * positive.min())
            axes.set_ylim(middle / 1.3, middle * 1.3)
        narrow = positive.max() < 100 * positive.min()  # few decades: label 1, 2, 5 too
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,)))
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.5, max(1, len(values)) + 0.5)


def _element(figure: Figure, title: str) -> str:
    """The figure as an ``<svg>`` element that scales with the page."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :].replace(TEXT_COLOUR, "currentColor")
    text = re.sub(r"<metadata>.*?</metadata>", f"<title>{title}</title>", text, flags=re.DOTALL)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    text = re.sub(r' id="([^"]*)"', lambda m: m.group() if m.group(1) in used else "", text)
    text = re.sub(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1" class="curve" role="img">', text, count=1)
    return text.replace("xlink:href", "href")
