"""The tutorials run as they stand, and print what the pages show."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from docs.write_tutorial import DOCS, PAGES, STEP, steps

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w])")
ABSOLUTE, RELATIVE = 0.03, 0.05
"""Numbers may differ by so much from machine to machine: motions are found to a hundredth of a voxel."""


def near(shown: str, printed: str) -> bool:
    """Whether two numbers are nearly the same; whole ones are counts and have to be the same."""
    if "." not in shown + printed:
        return shown == printed
    a, b = float(shown), float(printed)
    return abs(a - b) <= ABSOLUTE + RELATIVE * max(abs(a), abs(b))


def alike(shown: str, printed: str) -> bool:
    """Whether two outputs have the same words, and numbers that are nearly the same; spaces and frames aside."""
    words = [re.sub(r"[\s─━]+", " ", NUMBER.sub("#", text)).strip() for text in (shown, printed)]
    numbers = [NUMBER.findall(text) for text in (shown, printed)]
    return words[0] == words[1] and len(numbers[0]) == len(numbers[1]) and all(map(near, *numbers))


@pytest.mark.parametrize(
    ("shown", "printed", "expected"),
    [
        ("a 0.51 b", "a  0.52 b", True),
        ("a 0.51 b", "a 0.61 b", False),
        ("a 0.51 b", "c 0.51 b", False),
        ("a 1 2", "a 1", False),
        ("grains 20", "grains 19", False),
        ("rotations -4", "rotations 4", False),
    ],
)
def test_outputs_are_compared(shown, printed, expected):
    assert alike(shown, printed) is expected


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("tutorial")


@pytest.mark.parametrize("name", PAGES)
def test_a_tutorial_prints_what_it_shows(name, folder):
    count = 0
    for step in steps((DOCS / name).read_text(encoding="utf-8"), folder):
        shown = step.shown or ""
        assert alike(shown, step.output), f"{step.match['code']}\nrun: python docs/write_tutorial.py\n{step.output}"
        count += 1
    assert count >= 7


@pytest.mark.parametrize("name", PAGES)
def test_every_block_that_is_run_is_seen(name):
    text = (DOCS / name).read_text(encoding="utf-8")
    assert len(STEP.findall(text)) == len(re.findall(r"^```(?:sh|python|toml)$", text, re.MULTILINE))


def test_pictures_are_small():
    pictures = list((DOCS / "images" / "tutorial").iterdir())
    assert pictures
    assert sum(picture.stat().st_size for picture in pictures) < 1_000_000
