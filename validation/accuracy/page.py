"""The page ``docs/accuracy.md``."""

from __future__ import annotations

from validation.common.page import Page, Section, number, table

__all__ = ["CACHE", "PAGE", "PROCESSES", "Section", "figure", "number", "table"]

PAGE = Page("accuracy")
CACHE = PAGE.cache
figure = PAGE.figure
PROCESSES = 2
"""Trials at a time, at most."""
