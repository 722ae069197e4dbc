"""Full scans: where the comparison with correlation of full scans stands, and its table."""

from __future__ import annotations

import re

from validation.accuracy import page
from validation.common.page import ROOT

RESULT = ROOT / "validation" / "benchmarks" / "results" / "full_scan.md"


def study() -> page.Section:
    """The table of the benchmark, as it stands."""
    return section(RESULT.read_text())


def section(result: str) -> page.Section:
    """A shorter form of the benchmark's page."""
    lines = result.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("|"))
    rows = [line for line in lines[start:] if line.startswith("|")]
    made = re.search(r"Made by (.*?)\.?\s*$", result, re.DOTALL)
    command = " ".join(made[1].split()) if made else "the benchmark"
    text = f"""4 radiographs per state, compared with spam's discrete correlation of a full scan of the same state
(SART by grainmotion, FDK by RTK), with the reference scan and labels in common.  Made by {command};
`validation/benchmarks/results/full_scan.md` defines the states and methods, and what counts as a failure.

{chr(10).join(rows)}
"""
    return page.Section("Against full scans", text, "see its table: 4 radiographs compared with hundreds per state")
