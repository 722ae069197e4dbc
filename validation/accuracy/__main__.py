"""Run studies and write their sections: ``python -m validation.accuracy [STUDY ...]``; all of them without a name."""

from __future__ import annotations

from validation.accuracy.page import PAGE
from validation.common.command import run

STUDIES = ("hard_cases", "laboratory", "limits", "coverage", "projectors", "full_scans", "wrong_input")

if __name__ == "__main__":
    run(PAGE, STUDIES, "Measure the accuracy.")
