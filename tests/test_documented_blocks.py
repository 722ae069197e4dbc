"""Every fenced block of the documentation is of a language that is tested, and few are marked as not run."""

from __future__ import annotations

import re

import pytest

from documented_blocks import FENCE, PAGES, Block, blocks_of

BLOCKS = [block for page in PAGES for block in blocks_of(page)]
LANGUAGES = {"python", "toml", "sh", ""}
DIRECTIVE = re.compile(r"\{[a-z:-]+\}")
"""Of the documentation site, such as {toctree} and {math}; `make docs` reads them."""
MAX_NOT_RUN = 4
MAX_OTHERWISE = 2
MARK = re.compile(r"(not run: \S.*|in the test: .+ becomes .+|run with a stand-in for YADE|)")
CODE = re.compile(r"^\s*(import |from \w+ import|pip |make |python |grainmotion |\[\[?\w+\]|\w+ = )", re.MULTILINE)
"""Lines of a program, a terminal or an experiment file."""


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b.place)
def test_language_and_mark_are_known(block):
    assert block.language in LANGUAGES or DIRECTIVE.fullmatch(block.language)
    assert MARK.fullmatch(block.mark), block.mark


def test_plain_blocks_hold_no_code():
    plain = [block for block in BLOCKS if not block.language]
    assert plain
    assert [block.place for block in plain if CODE.search(block.text) or block.mark] == []


def test_few_blocks_are_not_run_as_they_stand():
    assert sum(not block.is_run for block in BLOCKS) <= MAX_NOT_RUN
    assert sum(block.is_run and bool(block.mark) for block in BLOCKS) <= MAX_OTHERWISE


def test_no_block_is_overlooked():
    """Every fence of a page opens or closes one of the blocks."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert len(re.findall(r"^\s*(?:```|~~~)", text, re.MULTILINE)) == 2 * len(blocks_of(page)), page


def test_marks_are_read():
    text = "<!-- not run: needs a scanner -->\n```python\nx = 1\n```\n\n```sh\nmake\n```\n"
    marked, plain = FENCE.finditer(text)
    assert (marked["mark"], marked["language"], marked["text"]) == ("not run: needs a scanner", "python", "x = 1\n")
    assert (plain["mark"], plain["language"]) == (None, "sh")
    assert not Block(PAGES[0], 2, "python", "x = 1\n", marked["mark"]).is_run
    assert Block(PAGES[0], 2, "python", "x = 1\n", "in the test: 1 becomes 2").code == "x = 2\n"
