"""Settings in the documentation pass the checker of the experiment file, also those in comments and in the text."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

from documented_blocks import PAGES, ROOT, blocks_in, inline_code
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment, read_experiment

RADIOGRAPHS = 'radiographs = "scan.nxs"'
STATE = {"name": '"step-01"', "radiographs": '"step-01/*.tif"', "geometry": '"step-01.csv"'}
COMMENTED = re.compile(r"^# (?=\w+ = )", re.MULTILINE)
SETTING = re.compile(r"(?:\[\[?(?P<table>[\w.]+)\]\]? )?(?P<key>[a-z]\w*)(?: = (?P<value>.+))?")
CIRCULAR = {"beam": '"parallel"', "pixel_size": "0.01", "first_row": '"top"', "angles_deg": "[0, 90]"}
REQUIRED = {
    "reference.geometry": CIRCULAR,
    "states.geometry": CIRCULAR,
    "segment.bodies": {"name": '"ring"', "place": '"around"'},
    "states": STATE,
    "watch": {"folders": '"steps/*"'},
}
"""Keys without which a table is refused."""
ARRAYS = {"states", "segment.phases", "segment.bodies"}


def completed(text: str) -> str:
    """A part of an experiment file, with what the checker requires besides."""
    data = tomllib.loads(text)
    if "reference" not in data:
        return f"{text}\n[reference]\n{RADIOGRAPHS}\n"
    if not {"radiographs", "volume"} & set(data["reference"]):
        if "[reference]" in text:
            return text.replace("[reference]", f"[reference]\n{RADIOGRAPHS}")
        return f"[reference]\n{RADIOGRAPHS}\n{text}"
    return text


def read_part(folder: Path, text: str) -> Experiment:
    """Check a part of an experiment file as a command would."""
    path = folder / "experiment.toml"
    path.write_text(completed(text), encoding="utf-8")
    return read_experiment(path)


@pytest.mark.parametrize("block", blocks_in("toml"), ids=lambda b: b.place)
def test_blocks_pass_the_checker(block, tmp_path):
    read_part(tmp_path, block.code)
    read_part(tmp_path, COMMENTED.sub("", block.code))


@pytest.mark.parametrize(
    "text", ['[reference]\nvolum = "a.tif"', '[output]\nvolumes = "tif"', "[watch]\ncount = 4", "[volume]\n# no = 1"]
)
def test_wrong_parts_are_refused(text, tmp_path):
    with pytest.raises(InputError):
        read_part(tmp_path, COMMENTED.sub("", text))


def settings_in_text() -> list[tuple[str, str]]:
    """Inline code that gives a key of a table, a value or both, with its page."""
    found = []
    for page in PAGES:
        for code in dict.fromkeys(inline_code(page)):
            match = SETTING.fullmatch(code)
            if match and (match["table"] or match["value"]):
                found.append((page.relative_to(ROOT).as_posix(), code))
    return found


@cache
def known_keys() -> dict[str, set[str]]:
    """Keys of each table, from the page that is made of the checker itself."""
    parts = re.split(r"^## `(\[.*)`$", (ROOT / "docs" / "experiment.md").read_text(), flags=re.MULTILINE)[1:]
    rows = [set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) for text in parts[1::2]]
    tables = [re.findall(r"\[([\w.]+)\]", heading) for heading in parts[::2]]
    return {name: keys for names, keys in zip(tables, rows, strict=True) for name in names}


def is_setting(folder: Path, code: str) -> bool:
    """Whether the checker takes a setting, in the table that it names or in any that has the key."""
    match = SETTING.fullmatch(code)
    tables = [table for table, keys in known_keys().items() if match["key"] in keys]
    if match["table"]:
        tables = [table for table in tables if table == match["table"]]
    return any(match["value"] is None or takes(folder, table, match["key"], match["value"]) for table in tables)


def takes(folder: Path, table: str, key: str, value: str) -> bool:
    """Whether the checker takes a value of a key."""
    lines = [f"{name} = {other}" for name, other in REQUIRED.get(table, {}).items() if name != key]
    header = f"[[{table}]]" if table in ARRAYS else f"[{table}]"
    if table == "states.geometry":
        header = "\n".join(["[[states]]", *(f"{n} = {v}" for n, v in STATE.items() if n != "geometry"), header])
    try:
        read_part(folder, "\n".join([header, *lines, f"{key} = {value}"]))
    except (InputError, tomllib.TOMLDecodeError):
        return False
    return True


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("[track] strain = true", True),
        ("[[states]] time", True),
        ('first_row = "top"', True),
        ("[track] strains", False),
        ("[output] strain = true", False),
        ('first_row = "left"', False),
        ("[[states]] time = [1", False),
    ],
)
def test_settings_are_told_from_others(code, expected, tmp_path):
    assert is_setting(tmp_path, code) is expected


def test_settings_in_the_text_pass_the_checker(tmp_path):
    settings = settings_in_text()
    assert len(settings) > 50
    assert [setting for setting in settings if not is_setting(tmp_path, setting[1])] == []
