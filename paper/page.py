"""The page ``docs/paper.md``: one section a study, each between markers, so that one study can be rerun alone."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "paper.md"
FIGURES = ROOT / "docs" / "images" / "paper"
CACHE = ROOT / ".paper"
"""Reconstructions kept between studies; remove it to begin afresh."""


@dataclass(frozen=True)
class Section:
    """What a study has to say, in Markdown, without its heading and command."""

    title: str
    text: str


def write(name: str, section: Section) -> None:
    """Put a study's section in its place on the page."""
    page = PAGE.read_text()
    body = f"## {section.title}\n\n{section.text.strip()}\n\nMade by `python -m paper {name}`.\n"
    marked = re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    if not marked.search(page):
        raise ValueError(f"{PAGE} has no place for {name}; add its begin and end markers")
    PAGE.write_text(marked.sub(lambda m: m[1] + "\n" + body + "\n" + m[2], page))


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines) + "\n"


def figure(name: str, image: Figure, caption: str) -> str:
    """Save a figure and give the Markdown that shows it."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    image.savefig(FIGURES / f"{name}.png", dpi=110, bbox_inches="tight")
    return f"![{caption}](images/paper/{name}.png)\n\n*{caption}*\n"
