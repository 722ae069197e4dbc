"""A page in ``docs``: one section per study, each between markers, so that one study can be rerun alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
from matplotlib.figure import Figure

from validation.common.cache import memory

P, Result = ParamSpec("P"), TypeVar("Result")
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Section:
    """Result of a study in Markdown, without heading and command.

    ``headline`` is its row in the summary table at the top of the page, if it has one.
    """

    title: str
    text: str
    headline: str = ""


@dataclass(frozen=True)
class Page:
    """The page ``docs/NAME.md`` of the package ``validation.NAME``, its figures, and the cache of its studies."""

    name: str
    root: Path = ROOT

    @property
    def path(self) -> Path:
        """The page."""
        return self.root / "docs" / f"{self.name}.md"

    @property
    def cache(self) -> Path:
        """Folder of results that studies share; remove it to compute everything anew."""
        return self.root / f".{self.name}"

    def cached(self, *sources: str) -> Callable[[Callable[P, Result]], Callable[P, Result]]:
        """Decorator: keep results on disk, valid while arguments, function and the named sources stay as they are."""

        def decorate(function: Callable[P, Result]) -> Callable[P, Result]:
            @wraps(function)
            def load_or_compute(*args: P.args, **kwargs: P.kwargs) -> Result:
                return memory(self.cache, sources).cache(function)(*args, **kwargs)

            return load_or_compute

        return decorate

    def write(self, name: str, section: Section) -> None:
        """Put a study's section, and its headline, in their places on the page."""
        page = self.path.read_text()
        body = f"## {section.title}\n\n{section.text.strip()}\n\nMade by `python -m validation.{self.name} {name}`.\n"
        marked = re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
        if not marked.search(page):
            raise ValueError(f"{self.path} has no place for {name}; add its begin and end markers")
        page = marked.sub(lambda m: m[1] + "\n" + body + "\n" + m[2], page)
        if section.headline:
            row = f"| [{section.title}](#{anchor(section.title)}) | {section.headline} <!-- headline {name} --> |"
            place = re.compile(rf"^\|.*<!-- headline {name} --> \|$", re.MULTILINE)
            if not place.search(page):
                raise ValueError(f"{self.path} has no row for the headline of {name}; add one with its marker")
            page = place.sub(lambda m: row, page)
        self.path.write_text(page)

    def figure(self, name: str, image: Figure, caption: str) -> str:
        """Save a figure and give the Markdown that shows it."""
        folder = self.root / "docs" / "images" / self.name
        folder.mkdir(parents=True, exist_ok=True)
        image.savefig(folder / f"{name}.png", dpi=110, bbox_inches="tight")
        return f"![{caption}](images/{self.name}/{name}.png)\n\n*{caption}*\n"


def anchor(title: str) -> str:
    """The link that a heading has on the web."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines) + "\n"


def number(value: float, digits: int) -> str:
    """A number for a table; – for none."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "–"
