"""The pages of the API name each public function, class and module exactly once."""

from __future__ import annotations

import importlib
import inspect
import re
from collections import Counter
from pathlib import Path

import pytest
from docs._ext.documented_constants import with_values

import grainmotion
from grainmotion.mechanics.strains import DEFAULT_REACH

PAGES = Path(__file__).parents[1] / "docs" / "api"
TABLE = re.compile(r"^```\{api\} (\S+)\n((?:\w+\n)+)```$", re.MULTILINE)
PARTS = (getattr(grainmotion, name) for name in grainmotion.__all__)
MODULES = [grainmotion, *(part for part in PARTS if inspect.ismodule(part))]


def listed() -> Counter[str]:
    """Full names in the tables of all pages, with how often each is there."""
    tables = [table for page in sorted(PAGES.glob("*.md")) for table in TABLE.findall(page.read_text(encoding="utf-8"))]
    return Counter(f"{module}.{name}" for module, names in tables for name in names.split())


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__)
def test_every_public_name_is_on_one_page(module):
    found = listed()
    assert {name: found[f"{module.__name__}.{name}"] for name in module.__all__} == dict.fromkeys(module.__all__, 1)


def test_pages_list_nothing_else():
    assert set(listed()) == {f"{module.__name__}.{name}" for module in MODULES for name in module.__all__}


def test_every_page_is_in_the_table_of_contents():
    index = (PAGES / "index.md").read_text(encoding="utf-8")
    toctree = re.search(r"```\{toctree\}\n(?::.*\n)*\n((?:\w+\n)+)```", index)
    assert toctree
    assert sorted(toctree[1].split()) == sorted(page.stem for page in PAGES.glob("*.md") if page.stem != "index")


def test_signatures_show_the_values_of_constants():
    module = "grainmotion.mechanics.strains"
    importlib.import_module(module)
    assert with_values("(motions, *, reach=DEFAULT_REACH)", module) == f"(motions, *, reach={DEFAULT_REACH!r})"
    assert with_values("(settings=NO_NUMBER, device='cpu')", module) == "(settings=NO_NUMBER, device='cpu')"
