"""The page itself: sections, styles, scripts and data put together in one file that needs no network."""

from __future__ import annotations

import dataclasses
import platform
from datetime import datetime
from importlib import metadata, resources
from pathlib import Path

from jinja2 import Environment
from markupsafe import Markup

from grainmotion._arguments import checked_arguments
from grainmotion.io.files import atomic_write
from grainmotion.model.finding import worst_first
from grainmotion.model.motions import Status
from grainmotion.report import tables
from grainmotion.report.data import ReportData
from grainmotion.report.page_data import page_data
from grainmotion.report.page_templates import page_templates
from grainmotion.report.states_in_detail import states_in_detail

STYLES = ("theme.css", "page.css", "panel.css", "table.css", "radiographs.css", "viewer.css", "print.css")
SCRIPTS = (
    "decode.js", "dom.js", "numbers.js", "colours.js", "app.js", "chart.js", "header.js", "panel.js", "history.js",
    "attention.js", "table_rows.js", "table.js", "projection.js", "footprints.js", "radiograph_images.js",
    "pan_zoom.js", "radiograph_panes.js", "radiograph_levels.js", "radiographs.js", "shadows.js", "slices.js",
    "fit.js", "vendor/three.min.js", "viewer_shapes.js", "viewer_motion.js", "viewer_scale.js", "viewer_cap.js",
    "viewer_grains.js", "viewer_bodies.js", "viewer_overlays.js", "viewer_camera.js", "viewer_panel.js",
    "viewer_legend.js", "viewer_canvas.js", "viewer.js", "start.js",
)  # fmt: skip
"""Files of ``assets/`` in the order in which the page holds them."""
PACKAGES = ("grainmotion", "numpy", "scipy", "numba", "scikit-image", "matplotlib")


@checked_arguments
def write_report(path: str | Path, data: ReportData) -> None:
    """Write one HTML page that opens offline: findings, grains in 3-D and as a table, radiographs, fit, settings.

    Large radiographs are averaged over blocks of pixels, so that the page stays small.

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

    Examples
    --------
    >>> from grainmotion.report.data import ReportData
    >>> gm.write_report("reference.html", ReportData("reference", volume=volume, labels=labels))
    """
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.writelines(_environment().get_template("page.html.j2").generate(_context(data)))


def _context(data: ReportData) -> dict[str, object]:
    """Values of the templates by name."""
    shown = states_in_detail(data)
    held = dataclasses.replace(data, states=tuple(data.states[k] for k in shown))
    summary = [tables.summary_row(state) for state in data.states]
    return {
        "title": data.title,
        "written": datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
        "findings": worst_first(data.findings),
        "summary": summary,
        "statuses": [s.value for s in Status if any(dict(row.counts)[s.value] for row in summary)],
        "facts": data.facts,
        "has_slices": data.volume is not None,
        "run": data.run,
        "shown": {k: place for place, k in enumerate(shown)},
        "data": page_data(held) | {"state_numbers": [k + 1 for k in shown], "state_count": len(data.states)},
        "version": _version("grainmotion"),
        "versions": data.run.versions if data.run is not None and data.run.versions else _versions(),
        "styles": [_asset(name) for name in STYLES],
        "scripts": [_asset(name) for name in SCRIPTS],
    }


def _environment() -> Environment:
    """The templates of the report, with its filters."""
    environment = page_templates()
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}
    environment.filters |= {"significant": tables.significant}
    return environment


def _asset(name: str) -> Markup:
    return Markup(resources.files("grainmotion.report").joinpath("assets", name).read_text(encoding="utf-8"))


def _versions() -> list[tuple[str, str]]:
    return [*((name, _version(name)) for name in PACKAGES), ("Python", platform.python_version())]


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "(unknown version)"
