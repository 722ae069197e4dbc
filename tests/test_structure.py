"""The structure of the package: number of files, types, signatures, constants, private names.

The numbers are upper bounds, to be lowered when the code gets below them.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parent
PACKAGE = TESTS.parent / "src" / "grainmotion"
SOURCES = sorted(PACKAGE.rglob("*.py"))
MAX_TOP_LEVEL_FILES = 9  # with __main__.py, which `python -m grainmotion` wants there
MAX_ANY_LINES = 6
MAX_PARAMETERS = 7


def trees() -> Iterator[tuple[str, ast.Module]]:
    """Path below the package and syntax tree of every source file."""
    for path in SOURCES:
        yield path.relative_to(PACKAGE).as_posix(), ast.parse(path.read_text())


def test_few_files_at_the_top():
    assert len([p for p in PACKAGE.iterdir() if p.is_file()]) <= MAX_TOP_LEVEL_FILES


def test_few_lines_with_any():
    lines = [line for path in SOURCES for line in path.read_text().splitlines() if re.search(r"\bAny\b", line)]
    assert len(lines) <= MAX_ANY_LINES


def test_no_long_signatures():
    long = set()
    for path, tree in trees():
        if path.startswith("kernels/"):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                if len([n for n in names if n not in ("self", "cls")]) > MAX_PARAMETERS:
                    long.add(f"{path}:{node.name}")
    assert long == set()


def test_no_constant_name_has_two_values():
    values: dict[str, set[str]] = defaultdict(set)
    for _, tree in trees():
        for name, value in constants(tree):
            values[name].add(value)
    shared = {name for name, different in values.items() if len(different) > 1}
    assert shared == set()


def constants(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Names in capitals that a module binds, and their values as source."""
    for node in tree.body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple):
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value] * len(target.elts)
                pairs = list(zip(target.elts, values, strict=True))
            for name, value in pairs:
                if isinstance(name, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9_]+", name.id):
                    yield name.id.lstrip("_"), ast.unparse(value)


def test_every_package_has_its_tests():
    packages = {p.parent.name for p in PACKAGE.glob("*/__init__.py")}
    tested = {p.parent.name for p in TESTS.glob("*/test_*.py")}
    assert packages - tested == set()


def test_private_names_stay_in_their_package():
    crossing = []
    for path, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("grainmotion."):
                package = node.module.split(".")[1]
                if package != path.split("/")[0]:
                    crossing += [f"{path}: {node.module}.{a.name}" for a in node.names if a.name.startswith("_")]
    assert crossing == []


def test_names_of_test_files_are_unique():
    names = [p.name for p in TESTS.rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))  # pytest imports them by their name alone
