"""The page itself: sections, styles and scripts put together in one file that needs no network."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from datetime import datetime
from importlib import metadata, resources
from pathlib import Path

import numpy as np
import plotly.offline
from jinja2 import Environment
from markupsafe import Markup

from grainmotion.io.files import atomic_write
from grainmotion.model.finding import worst_first
from grainmotion.report import curves, images, tables
from grainmotion.report.arrows import scenes
from grainmotion.report.data import ReportData, StateReport
from grainmotion.report.page_templates import page_templates

MAX_PIXELS = 1_600_000  # of all radiographs on the page together: about 2 MB
MAX_IMAGE_PIXELS, MIN_IMAGE_PIXELS = 640_000, 4_000  # of one radiograph
MAX_TABLE_ROWS = 5_000  # grains in all tables together: about 2 MB
MAX_ARROWS = 3_000  # grains drawn in three dimensions, all states together: about 2 MB
PACKAGES = ("grainmotion", "numpy", "scipy", "numba", "scikit-image", "matplotlib", "plotly")


def write_report(path: str | Path, data: ReportData) -> None:
    """Write one HTML page that opens offline: findings, radiographs, convergence, grains, arrows.

    Large radiographs are averaged over blocks of pixels, so that the page stays below about 10 MB.

    Parameters
    ----------
    path : path
        The file to write, usually ``report.html``; it is replaced once the new page is whole.
    data : ReportData
        Its content.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.writelines(_environment().get_template("page.html.j2").generate(_context(data)))


def _context(data: ReportData) -> dict[str, object]:
    """Values of the templates by name."""
    count = max(1, len(data.states))
    radiographs = 3 * sum(len(state.views) for state in data.states)
    pixels = int(np.clip(MAX_PIXELS // max(1, radiographs), MIN_IMAGE_PIXELS, MAX_IMAGE_PIXELS))
    return {
        "title": data.title,
        "written": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
        "findings": worst_first(data.findings),
        "summary": [tables.summary_row(state) for state in data.states],
        "reference": _reference(data),
        "states": [_state(state, pixels, MAX_TABLE_ROWS // count) for state in data.states],
        "arrows": [scenes(state.motions, state.voxel_size, MAX_ARROWS // count) for state in data.states],
        "versions": {name: _version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "system": platform.system(),
        "style": _asset("page.css"),
        "script": _asset("page.js"),
        "plotly": Markup(plotly.offline.get_plotlyjs()),
    }


def _reference(data: ReportData) -> Mapping[str, object]:
    errors = data.reconstruction_errors
    curve = Markup(curves.reconstruction_svg(errors)) if errors else None
    if data.volume is None:
        return {"facts": data.facts, "curve": curve, "slices": ()}
    scale = images.grey_scale(data.volume.array)
    slices = images.central_slices(data.volume, data.labels, scale)
    return {"facts": data.facts, "curve": curve, "slices": slices, "scale": scale}


def _state(state: StateReport, pixels: int, rows: int) -> Mapping[str, object]:
    fit = state.motions.fit
    assert state.residual is not None  # StateReport fills it
    grey = images.grey_scale(state.measured, state.simulated)
    diverging = images.diverging_scale(state.residual)
    views = images.radiographs(state, grey, diverging, pixels)
    return {
        "name": state.name,
        "attention": tables.attention_groups(state.motions),
        "facts": tables.fit_facts(state),
        "notes": fit.notes,
        "corrections": tables.correction_rows(fit, state.views),
        "bodies": tables.body_rows(state),
        "appeared": tables.appeared_rows(state),
        "pieces": tables.piece_rows(state),
        "comparison": state.comparison,
        "curve": Markup(curves.convergence_svg(fit.costs)) if fit.costs else None,
        "radiographs": {"views": views, "grey": grey, "diverging": diverging},
        "grains": tables.grain_table(state, rows),
    }


def _environment() -> Environment:
    """The templates of the report, with its filters."""
    environment = page_templates()
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}
    environment.filters |= {"significant": tables.significant, "palette_png": images.palette_png}
    return environment


def _asset(name: str) -> Markup:
    return Markup(resources.files("grainmotion.report").joinpath(name).read_text(encoding="utf-8"))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "(unknown version)"
