"""The drawings of docs/conventions.md are those that the package's geometry gives now."""

from __future__ import annotations

import io
import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from docs.images import make_conventions, make_grids

IMAGES = Path(__file__).parents[1] / "docs" / "images"
TOLERANCE = 3.0
"""Points; fonts of other machines move what is drawn a little."""


def coordinates(svg: str) -> np.ndarray:
    """All numbers of the lines of a drawing, without those of its letters."""
    shapes = re.sub(r"<defs>.*?</defs>|<g id=\"text_\d+\">.*?</g>\s*</g>", "", svg, flags=re.DOTALL)
    paths = re.findall(r'<path d="([^"]*)"', shapes)
    return np.array([float(number) for path in paths for number in re.findall(r"-?\d+\.?\d*", path)])


@pytest.mark.parametrize(
    ("module", "name"), [(make_conventions, "conventions.svg"), (make_grids, "grids.svg")], ids=lambda x: str(x)
)
def test_the_stored_drawing_is_the_one_that_is_drawn_now(module, name):
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "grainmotion"}):
        module.draw().savefig(buffer, format="svg")
    now, stored = coordinates(buffer.getvalue()), coordinates((IMAGES / name).read_text(encoding="utf-8"))
    assert len(now) > 100
    assert now.shape == stored.shape
    np.testing.assert_allclose(now, stored, atol=TOLERANCE, err_msg=f"draw docs/images/{name} again")


def test_the_grain_is_higher_on_the_drawing_and_its_row_depends_on_first_row():
    rows = {name: make_grids.views(name).project_points(make_grids.GRAIN[None])[0, 0, 0] for name in ("bottom", "top")}
    middle = (make_grids.PANEL[0] - 1) / 2
    assert rows["bottom"] > middle > rows["top"]
    assert rows["bottom"] + rows["top"] == pytest.approx(2 * middle)
