"""The page that lists every key is what the program knows."""

import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_page_is_up_to_date():
    done = subprocess.run(
        [sys.executable, DOCS / "write_experiment_reference.py", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
