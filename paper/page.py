"""The page ``docs/paper.md``."""

from __future__ import annotations

from studies.page import Page, Section, table

__all__ = ["CACHE", "PAGE", "Section", "figure", "table", "write"]

PAGE = Page("paper")
CACHE = PAGE.cache
write, figure = PAGE.write, PAGE.figure
