"""The page ``docs/paper.md``."""

from __future__ import annotations

from validation.common.page import Page, Section, table

__all__ = ["CACHE", "PAGE", "Section", "figure", "table", "write"]

PAGE = Page("paper")
CACHE = PAGE.cache
write, figure = PAGE.write, PAGE.figure
