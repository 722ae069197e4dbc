"""Tables on the terminal: whatever its width, no name and no number is cut off."""

import io

import pytest
from rich.console import Console

from grainmotion.cli.tables import print_within

NAMES = ["scan", "radiographs", "pixel at sample", "magnification", "air", "masked pixels"]
ROWS = [
    ("reference", "1440 x 2048 x 2048", "0.0125 mm", "12.5", "-0.0001", "12345 (10 dead, 5 dark, 3 saturated)"),
    ("states.step-01", "4 x 2048 x 2048", "0.0125 mm", "12.5", "0.0002", "0 (0 dead, 0 dark, 0 saturated)"),
]


def printed(width: int, keys: int = 1) -> list[str]:
    console = Console(width=width, file=io.StringIO())
    print_within(console, NAMES, ROWS, keys=keys)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("width", [80, 100, 200])
def test_every_name_and_number_is_there_in_one_piece(width):
    lines = printed(width)
    assert max(map(len, lines)) <= width
    cells = {cell.strip() for line in lines for cell in line.replace("┃", "│").split("│")}
    assert {*NAMES, *ROWS[0], *ROWS[1]} <= cells


def test_a_wide_console_has_one_table_and_a_narrow_one_several_that_name_their_rows():
    assert sum("reference" in line for line in printed(200)) == 1
    assert sum("reference" in line for line in printed(80)) == 2
    narrow = printed(80, keys=2)
    assert sum("reference" in line and "1440 x 2048 x 2048" in line for line in narrow) == sum(
        "reference" in line for line in narrow
    )


def test_what_is_wider_than_the_console_is_folded():
    text = "".join(cell.strip() for line in printed(30) for cell in line.split("│"))
    assert "…" not in text
    assert "saturated)" in text
