"""The live page of a watch, ``watch.html``: one file that a browser loads again by itself; no server, no scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

from grainmotion.io.files import atomic_write
from grainmotion.report.page_templates import page_templates
from grainmotion.report.tables import significant

REFRESH_SECONDS = 3
"""Time after which a browser loads the page again."""


@dataclass(frozen=True)
class WatchRow:
    """One state on the page; lengths in mm, times in seconds, None or NaN where not known."""

    name: str
    phase: str
    message: str
    files: str
    last_arrival: datetime | None
    counts: str
    usable: str
    residual: float
    largest: float
    grain: str
    seconds: float | None
    tracking_seconds: float | None


@dataclass(frozen=True)
class WatchPage:
    """Content of the page."""

    experiment: str
    folder: str
    rows: Sequence[WatchRow]
    notes: Sequence[str] = ()
    report: str | None = None  # name of the full report, beside the page
    ended: str = ""  # why the watch ended; empty while it goes on


def write_watch_page(path: str | Path, page: WatchPage) -> None:
    """Write the page; every text of the user is escaped."""
    environment = page_templates()
    environment.filters["number"] = _number
    text = environment.get_template("watch.html.j2").render(
        page=page,
        refresh=REFRESH_SECONDS,
        written=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S"),
        version=version("grainmotion"),
    )
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _number(value: float | None, unit: str = "") -> str:
    """A number to a few digits with its unit; a dash if it is not known."""
    if value is None or value != value:
        return "–"
    return f"{significant(value)} {unit}".strip()
