"""The Python blocks of pages and the examples of docstrings run as they stand, beside a small finished experiment."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import shutil
import sys
from pathlib import Path

import pytest
from docs.write_tutorial import PAGES

import grainmotion
from documented_blocks import ROOT, Block, blocks_in, blocks_of
from documented_experiment import write_documented
from yade_stand_in import names_of_yade, yade_module

BLOCKS = blocks_in("python")
EXPECTED = {
    "README.md": "len(motions) == 6 and motions.ok_translation.all()",
    "docs/dem.md": "mesh.is_watertight and len(h.coefficients) == 169 and k == len(grains) == 6"
    " and len(O.bodies.clumps) == 6"
    " and abs(1e3 * O.bodies.centers() - poses.query('state == \"step-01\"')[['x', 'y', 'z']]).max(axis=None) < 0.05",
    "docs/how-to/bad-grains.md": "len(usable) == 6 and set(look_at['status']) <= {'poorly-determined', 'ambiguous'}",
    "docs/export.md": "len(points) == len(arrows) == 6 and set(labels.flat) == set(moved.flat) == set(range(7))",
    "docs/mechanics.md": "len(before.pairs) >= 12 and len(changes.pairs) >= 12 and field.at_hull.all()",
    "docs/series.md": "len(third.fit.start_residuals) == 2 and third.ok_translation.all() and len(table) == 12",
    "docs/viewer.md": "'tracks' in [keywords['name'] for _, keywords, _ in made]",
    "docs/volumes.md": "len(grains) == 6",
}
"""What holds of the names of each page after its last block.

Spheres of a clump overlap, so their mean is near its pose, not at it.
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory) -> Path:
    """Folder of a finished experiment."""
    folder = tmp_path_factory.mktemp("documented")
    write_documented(folder)
    return folder


TUTORIALS = {f"docs/{name}" for name in PAGES}
"""Pages with data of their own, which `test_tutorial` runs."""


def page_of(block: Block) -> str:
    return block.page.relative_to(ROOT).as_posix()


def test_every_page_with_python_is_run():
    assert {page_of(block) for block in BLOCKS if block.is_run} == set(EXPECTED) | TUTORIALS


@pytest.mark.parametrize("page", EXPECTED)
def test_blocks_of_a_page_run_in_order(page, experiment, tmp_path, monkeypatch):
    """They share their names, as in one notebook, and define all that they use."""
    monkeypatch.chdir(shutil.copytree(experiment, tmp_path / "work"))
    monkeypatch.setitem(sys.modules, "yade", yade_module())
    names: dict[str, object] = {"__name__": "__main__", **names_of_yade()}
    for block in BLOCKS:
        if page_of(block) == page and block.is_run:
            exec(compile(block.code, block.place, "exec"), names)
    assert eval(EXPECTED[page], names), EXPECTED[page]


@pytest.mark.parametrize("block", [b for b in BLOCKS if not b.is_run], ids=lambda b: b.place)
def test_blocks_that_are_not_run_import_what_exists(block):
    for node in ast.walk(ast.parse(block.text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("grainmotion"):
            module = importlib.import_module(node.module)
            assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == []


API_INDEX = ROOT / "docs" / "api" / "index.md"
PUBLIC = (grainmotion, grainmotion.simulate, grainmotion.viewer)
EXAMPLES = {
    f"{module.__name__}.{name}": example
    for module in PUBLIC
    for name in module.__all__
    if not inspect.ismodule(item := getattr(module, name))
    for example in doctest.DocTestFinder(recurse=False).find(inspect.unwrap(item), name, globs={})
    if example.examples
}


@pytest.fixture(scope="module")
def names_of_examples() -> dict[str, object]:
    """What the lines on the first page of the API define."""
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks_of(API_INDEX):
        if block.language == "python":
            exec(compile(block.code, block.place, "exec"), names)
    return names


@pytest.fixture(scope="module")
def folder_of_examples(experiment, tmp_path_factory) -> Path:
    """A copy of the experiment, for all examples: none of them changes it."""
    return shutil.copytree(experiment, tmp_path_factory.mktemp("examples") / "work")


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_a_docstring_runs(name, names_of_examples, folder_of_examples, monkeypatch):
    """Each begins with the names of the page, not with those of other examples."""
    monkeypatch.chdir(folder_of_examples)
    example = EXAMPLES[name]
    example.globs = dict(names_of_examples)
    printed: list[str] = []
    assert doctest.DocTestRunner().run(example, out=printed.append).failed == 0, "".join(printed)
