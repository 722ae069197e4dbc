"""The page on troubleshooting names all that the package can say: errors by where they begin, reasons, statuses."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from grainmotion.model.motions import Status
from grainmotion.model.usable_parts import POORLY_DETERMINED_REASON
from grainmotion.tracking import absent_grains, classification, missing_grains, unlike_neighbours

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "grainmotion"
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
BAD_GRAINS = (ROOT / "docs" / "how-to" / "bad-grains.md").read_text(encoding="utf-8")
ERRORS = {"InputError", "WriteError", "BackendError"}


@cache
def code() -> str:
    """The source of the package, with texts that go over several lines joined."""
    return re.sub(r'"\s*\n\s*f?"', "", "".join(p.read_text(encoding="utf-8") for p in PACKAGE.rglob("*.py")))


def section(heading: str) -> str:
    """The text of a section of the page, up to the next heading of its level or above."""
    level = heading.split()[0]
    return re.split(rf"^#{{2,{len(level)}}} ", PAGE.split(f"\n{heading}\n")[1], flags=re.MULTILINE)[0]


def quoted(text: str) -> list[str]:
    """Texts in back-ticks."""
    return re.findall(r"`([^`\n]+)`", text)


def beginnings(tree: ast.AST) -> set[str]:
    """First words of the places of errors, as far as they are written out: ``geometry`` of ``geometry.pixel_size``."""
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.args]
    places = [call.args[0] for call in calls if call.func.id in ERRORS]
    texts = [p.values[0] if isinstance(p, ast.JoinedStr) else p for p in places]
    words = (
        re.split(r"[ .:(\[]", t.value)[0] for t in texts if isinstance(t, ast.Constant) and isinstance(t.value, str)
    )
    return {word for word in words if word}


def test_beginnings_are_found():
    code = 'InputError("geometry.step", "a", "b")\nWriteError(f"states {x}", "a", "b")\nInputError(str(path), "a", "b")'
    assert beginnings(ast.parse(code)) == {"geometry", "states"}


def test_page_names_where_errors_begin():
    known = {name.rstrip(".").split(".")[0] for name in quoted(section("### By where they begin"))}
    found = {word for path in PACKAGE.rglob("*.py") for word in beginnings(ast.parse(path.read_text(encoding="utf-8")))}
    assert len(found) > 70
    # What the states' own errors call "state 'NAME'" is written by the simulator of data sets.
    assert found - known - {"state"} == set()


@pytest.mark.parametrize("text", quoted(section("### By what they say").partition("remedy |")[2]))
def test_quoted_errors_are_in_the_package(text):
    """Each quoted text of the first column, keys and options aside, stands in the code; no page tells old messages."""
    if text.startswith(("--", "[", "grainmotion ")) or re.fullmatch(r"[a-z_]+|/", text):
        return
    assert text in code()


@pytest.mark.parametrize("status", [s.value for s in Status])
def test_each_status_has_a_row(status):
    assert re.search(rf"^\| `{status}` \|", BAD_GRAINS, re.MULTILINE)


REASONS = [
    POORLY_DETERMINED_REASON,
    classification.AMBIGUOUS_REASON,
    classification.REFERENCE_REASON,
    classification.STILL_MOVING,
    missing_grains.MISSING_REASON,
    unlike_neighbours.UNLIKE_REASON,
    absent_grains.NONE_REASON,
    absent_grains.ELSEWHERE_REASON,
]


@pytest.mark.parametrize("reason", REASONS)
def test_each_reason_begins_as_on_the_page(reason):
    rows = [text.rstrip("…").strip() for text in quoted(BAD_GRAINS.split("## By reason")[1].split("\n## ")[0])]
    assert any(reason.startswith(row) or row.startswith(reason) for row in rows), reason


@pytest.mark.parametrize("text", quoted(BAD_GRAINS.split("## By reason")[1].split("\n## ")[0]))
def test_quoted_reasons_are_in_the_package(text):
    if text.startswith("[") or re.fullmatch(r"[a-z_]+", text):
        return
    assert all(part.strip() in code() for part in text.split("…")), text
