"""The documentation page of all keys agrees with the schema of the experiment file."""

import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_page_of_keys_is_up_to_date():
    done = subprocess.run(
        [sys.executable, DOCS / "write_experiment_reference.py", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
