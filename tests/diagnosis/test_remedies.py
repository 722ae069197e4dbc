"""Every warning and error that checks give says what to do."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import grainmotion

PACKAGE = Path(grainmotion.__file__).parent
PLACE_OF_REMEDY = 5
"""Among the arguments of `Finding`."""


def calls() -> Iterator[tuple[str, ast.Call]]:
    """Every place where a finding is made."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding":
                yield f"{path.relative_to(PACKAGE)}:{node.lineno}", node


def says_what_to_do(call: ast.Call) -> bool:
    """Whether a finding is a note, or is given a remedy that is not empty."""
    if ast.unparse(call.args[0] if call.args else call) == "Level.NOTE":
        return True
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    remedy = given.get("remedy", call.args[PLACE_OF_REMEDY] if len(call.args) > PLACE_OF_REMEDY else None)
    return remedy is not None and not (isinstance(remedy, ast.Constant) and not remedy.value)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ('Finding(Level.NOTE, "pixels", where, fact)', True),
        ('Finding(Level.WARNING, "pixels", where, fact)', False),
        ('Finding(Level.WARNING, "pixels", where, fact, remedy="")', False),
        ('Finding(level, "pixels", where, fact, remedy=remedy)', True),
        ('Finding(Level.ERROR, "pixels", where, fact, evidence, "look")', True),
    ],
)
def test_a_remedy_is_recognised(source, expected):
    assert says_what_to_do(ast.parse(source, mode="eval").body) is expected


def test_all_findings_but_notes_have_a_remedy():
    found = dict(calls())
    assert len(found) > 50
    assert [place for place, call in found.items() if not says_what_to_do(call)] == []
