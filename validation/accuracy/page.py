"""The page ``docs/accuracy.md``."""

from __future__ import annotations

from validation.common.page import Page, Section, number, table

__all__ = ["PAGE", "PROCESSES", "Section", "figure", "number", "table"]

PAGE = Page("accuracy")
figure = PAGE.figure
PROCESSES = 2
"""Most trials at a time."""
