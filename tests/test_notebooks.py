"""The notebooks in `examples/notebooks`: without outputs, with a title, on the documentation site, links that lead on.

`make notebooks` runs them, and so does `make docs`.
"""

import ast
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path: Path, kind: str) -> list[dict]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


def text(cell: dict) -> str:
    return "".join(cell["source"])


def test_there_are_notebooks():
    assert len(NOTEBOOKS) >= 4


@each_notebook
def test_no_outputs_are_stored(path):
    for cell in cells(path, "code"):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


@each_notebook
def test_it_begins_with_a_title_and_says_what_it_is_about(path):
    first, *rest = text(cells(path, "markdown")[0]).split("\n")
    assert re.fullmatch(r"# \S.*", first)
    assert len("".join(rest)) > 40
    titles = [line for cell in cells(path, "markdown") for line in text(cell).split("\n") if line.startswith("# ")]
    assert titles == [first]  # the site makes one page of it


@each_notebook
def test_it_is_in_the_contents_of_the_site(path):
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md"))
    assert f"/examples/notebooks/{path.stem}" in pages


@each_notebook
def test_its_links_lead_somewhere(path):
    for cell in cells(path, "markdown"):
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text(cell)):
            assert target.startswith("https://") or (path.parent / target).is_file(), target


@each_notebook
def test_it_works_in_folders_of_its_own_making_only(path):
    """No path of this repository or of one machine, so that it runs wherever it is copied to."""
    for cell in cells(path, "code"):
        code = "\n".join("pass" if line.startswith("!") else line for line in text(cell).split("\n"))
        strings = [
            n.value for n in ast.walk(ast.parse(code)) if isinstance(n, ast.Constant) and isinstance(n.value, str)
        ]
        assert not [s for s in strings if s.startswith(("/", "~", "../", "examples/", "tests/"))]
