"""The documentation names what exists: code named in `docs/architecture.md`, links between pages, decision records."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import get_args

import pytest

from grainmotion.model.finding import Check
from grainmotion.model.motions import Status

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "grainmotion"
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "validation").rglob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
]
RESULT_FILES = {"motions.csv", "motions.h5", "reference.h5", "residuals.tif", "report.html", "stages.json"}
NOT_CODE = re.compile(r"^(make|python|pip|git|pytest|grainmotion) |^lint-imports$|^--|\s|=|^\[|^\.[a-z]")
"""Back-ticked text that is no name: commands, options, assignments, tables of the experiment file, hidden folders."""


def backticked(page: Path) -> list[str]:
    """Texts between single back-ticks, outside code blocks."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", text)


@cache
def modules() -> dict[str, Path]:
    """Source files by dotted name below the package: ``tracking.track``, ``tracking``."""
    files = {p: p.relative_to(PACKAGE).with_suffix("").parts for p in PACKAGE.rglob("*.py")}
    return {".".join(part for part in parts if part != "__init__"): path for path, parts in files.items()}


@cache
def definitions(path: Path) -> dict[str, set[str]]:
    """Names that a module defines at its top; of classes, the names in their body and of ``self``."""
    names: dict[str, set[str]] = {}
    for node in ast.parse(path.read_text()).body:
        inner = set()
        if isinstance(node, ast.ClassDef):
            inner = {name for child in node.body for name in bound(child)}
            inner |= {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store)}
            inner |= {name for base in node.bases for name in inherited(base)}
        names |= {name: inner for name in bound(node)}
    return names


def inherited(base: ast.expr) -> set[str]:
    """Names in the body of a base class of the package."""
    return class_bodies().get(base.id, set()) if isinstance(base, ast.Name) else set()


@cache
def class_bodies() -> dict[str, set[str]]:
    """Names in the bodies of all classes of the package."""
    nodes = [node for path in modules().values() for node in ast.parse(path.read_text()).body]
    return {
        node.name: {n for child in node.body for n in bound(child)} for node in nodes if isinstance(node, ast.ClassDef)
    }


def bound(node: ast.stmt) -> list[str]:
    """Names that a statement binds."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.Import | ast.ImportFrom):
        return [alias.asname or alias.name for alias in node.names]
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return [n.id for target in targets if target is not None for n in ast.walk(target) if isinstance(n, ast.Name)]


def exists(name: str) -> bool:
    """Whether ``name`` is a file, a module, or something that a module or class defines."""
    name = name.split("(")[0]
    places = (ROOT, PACKAGE, ROOT / "validation", ROOT / "docs")
    if any((place / name).exists() for place in places) or Path(name).name in RESULT_FILES:
        return True
    if "/" in name or name.endswith(".py"):
        return any(path.as_posix().endswith("/" + name) for path in PACKAGE.rglob("*.py"))
    head, _, rest = name.removeprefix("grainmotion.").partition(".")
    for module, path in modules().items():
        inside = definitions(path)
        if name in (module, module.rpartition(".")[2]):
            return True
        if head in inside and (not rest or rest in inside[head]):
            return True
        for prefix in {module, module.rpartition(".")[2]} - {""}:
            first, _, attribute = name.removeprefix(f"{prefix}.").partition(".")
            if name.startswith(f"{prefix}.") and first in inside and (not attribute or attribute in inside[first]):
                return True
    return not rest and any(head in members for path in modules().values() for members in definitions(path).values())


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tracking/multistage.py", True),
        ("tracking.track", True),
        ("GrainSet", True),
        ("Volume.zeros", True),
        ("model.volume.Volume.zeros", True),
        ("validation/common/page.py", True),
        ("cluster/crew.py", False),
        ("Volume.Cast", False),
        ("Target.nothing", False),
        ("tracking.nothing", False),
        ("nothing", False),
    ],
)
def test_names_are_resolved(name, expected):
    assert exists(name) is expected


@pytest.mark.parametrize(("page", "least"), [("architecture.md", 50), ("method.md", 30)])
def test_pages_name_code_that_exists(page, least):
    names = [name for name in backticked(ROOT / "docs" / page) if not NOT_CODE.search(name)]
    assert len(names) > least
    assert [name for name in dict.fromkeys(names) if not exists(name)] == []


def test_reliability_names_tests_that_exist():
    names = [name for name in backticked(ROOT / "docs" / "reliability.md") if name.startswith("tests/")]
    assert len(names) > 5
    assert [name for name in names if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    broken = []
    for link in links:
        target, _, heading = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue
        file = (page.parent / target).resolve() if target else page
        if not file.exists() or (heading and file.suffix == ".md" and heading not in anchors(file)):
            broken.append(link)
    assert broken == []


def anchors(page: Path) -> set[str]:
    """Links that the headings of a page have on the web."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("record", DECISIONS, ids=lambda p: p.stem)
def test_decision_records_have_date_and_status(record):
    number, lines = record.name[:4], record.read_text().splitlines()
    assert lines[0].startswith(f"# {number} ")
    assert re.fullmatch(r"- Date: \d{4}-\d\d-\d\d", lines[2])
    status = re.fullmatch(r"- Status: (.*)", lines[3])
    assert status
    assert re.match(r"accepted|superseded by \d{4}", status[1])
    index = (record.parent / "README.md").read_text()
    row = f"| [{number}]({record.name}) | {lines[0][7:]} | {lines[2][8:]} | {status[1]} |"
    assert row in index, f"docs/decisions/README.md lacks the line\n{row}"


def test_troubleshooting_has_a_section_on_every_check():
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    assert set(re.findall(r"^### `([a-z-]+)`$", page, re.MULTILINE)) == set(get_args(Check))


def test_glossary_has_every_status():
    page = (ROOT / "docs" / "glossary.md").read_text()
    words = re.findall(r"^\| `([a-z-]+)` \| Status of ", page, re.MULTILINE)
    assert sorted(words) == sorted(status.value for status in Status)
    assert words == sorted(words)


def test_search_orders_pages_that_exist():
    script = (ROOT / "docs" / "_static" / "search_scores.js").read_text()
    names = {name for pattern in re.findall(r"/\^\S+/(?=\.test)", script) for name in re.findall(r"[\w-]{5,}", pattern)}
    pages = [page.relative_to(ROOT).as_posix() for page in [*PAGES, *(ROOT / "release").glob("*.md")]]
    assert {"decisions", "how-to", "validation"} < names
    assert {name for name in names if not any(re.match(rf"(docs/)?{name}", page) for page in pages)} == set()


def test_style_sheets_name_files_that_exist():
    sheets = sorted((ROOT / "docs" / "_static").glob("*.css"))
    files = [sheet.parent / name for sheet in sheets for name in re.findall(r"url\(\"([^\"]+)\"\)", sheet.read_text())]
    assert files
    assert [file for file in files if not file.is_file()] == []
