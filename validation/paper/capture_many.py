"""Capture of 200 grains, with 4 and 6 views: with fewer, hundreds of overlapping grains take minutes to search."""

from __future__ import annotations

from validation.paper.capture import cells, run, setting
from validation.paper.page import Section

VIEWS = (4, 6)


def study() -> Section:
    """Both moves."""
    return Section("Capture in three dimensions: 200 grains", f"{setting(200)}\n\n{cells(run(200, VIEWS), 200, VIEWS)}")
