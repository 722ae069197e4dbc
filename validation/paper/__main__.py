"""Run studies and write their sections: ``python -m validation.paper [STUDY ...]``; all of them without a name."""

from __future__ import annotations

from validation.common.command import run
from validation.paper.page import PAGE

STUDIES = (
    "images",
    "table1",
    "table2",
    "figure4",
    "capture",
    "capture_many",
    "baseline",
    "tables34",
    "reconstruction",
    "choices",
)

if __name__ == "__main__":
    run(PAGE, STUDIES, "Rerun the paper's results.")
