"""The fenced blocks and the inline code of the pages of the documentation.

A comment on the line before a block says what a test does otherwise than the page:

- ``<!-- not run: REASON -->``: the block is not run;
- ``<!-- run with a stand-in for YADE -->``: the names of YADE are those of `yade_stand_in`;
- ``<!-- in the test: OLD becomes NEW; ... -->``: it is run with these texts replaced, so that it takes seconds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/savu/README.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
]
FENCE = re.compile(
    r"(?:^<!-- (?P<mark>[^\n]*) -->\n)?^```(?P<language>\S*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page; `mark` is the comment before it, or empty."""

    page: Path
    line: int
    language: str
    text: str
    mark: str

    @property
    def place(self) -> str:
        """Page and line of the block, as ``docs/dem.md:3``."""
        return f"{self.page.relative_to(ROOT).as_posix()}:{self.line}"

    @property
    def is_run(self) -> bool:
        """Whether no mark says that it is not run."""
        return not self.mark.startswith("not run: ")

    @property
    def code(self) -> str:
        """The text as it is run: with the replacements of the mark."""
        text = self.text
        if self.mark.startswith("in the test: "):
            for pair in self.mark.removeprefix("in the test: ").split("; "):
                old, new = pair.split(" becomes ")
                assert old in text, f"{self.place}: the mark replaces '{old}', which the block does not have"
                text = text.replace(old, new)
        return text


def blocks_of(page: Path) -> list[Block]:
    """All fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text[: m.start("text")].count("\n"), m["language"], m["text"], m["mark"] or "")
        for m in FENCE.finditer(text)
    ]


def blocks_in(language: str) -> list[Block]:
    """All blocks of all pages in one language."""
    return [block for page in PAGES for block in blocks_of(page) if block.language == language]


def inline_code(page: Path) -> list[str]:
    """Texts between single back-ticks, outside of fenced blocks."""
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", FENCE.sub("", page.read_text(encoding="utf-8")))
