"""Run studies and write their sections: ``python -m accuracy [STUDY ...]``; all of them without a name."""

from __future__ import annotations

from studies.command import run

from accuracy.page import PAGE

STUDIES = ("hard_cases", "limits", "coverage", "projectors", "full_scans")

if __name__ == "__main__":
    run(PAGE, STUDIES, "Measure the accuracy.")
