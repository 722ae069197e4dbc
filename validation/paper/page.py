"""The page ``docs/paper.md``."""

from __future__ import annotations

from validation.common.page import Page, Section, table

__all__ = ["PAGE", "Section", "figure", "table"]

PAGE = Page("paper")
figure = PAGE.figure
