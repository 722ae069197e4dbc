"""Run the notebooks of ``examples/notebooks``: ``python docs/run_notebooks.py [NAME ...]``, the target `notebooks`.

Each runs in an empty folder and fails at its first error.  Nothing is kept but what ``--keep FOLDER`` asks for: the
notebooks with their outputs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

NOTEBOOKS = Path(__file__).parents[1] / "examples" / "notebooks"
SECONDS_A_CELL = 600


def run(path: Path, keep: Path | None) -> str | None:
    """Run a notebook; what went wrong, or None."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(notebook, timeout=SECONDS_A_CELL, resources={"metadata": {"path": folder}})
        try:
            client.execute()
        except CellExecutionError as error:
            return str(error)
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, keep / path.name)
    return None


def main() -> int:
    """Run all notebooks, or those whose names contain one of the arguments; 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of names of notebooks; all of them unless given")
    parser.add_argument("--keep", type=Path, help="folder for the notebooks with their outputs")
    options = parser.parse_args()
    chosen = [
        p for p in sorted(NOTEBOOKS.glob("*.ipynb")) if not options.names or any(n in p.name for n in options.names)
    ]
    failed = 0
    for path in chosen:
        start = time.monotonic()
        error = run(path, options.keep)
        print(f"{path.name}: {'ran' if error is None else 'FAILED'}, {time.monotonic() - start:.0f} s", flush=True)
        if error is not None:
            print(error)
            failed += 1
    return 1 if failed or not chosen else 0


if __name__ == "__main__":
    sys.exit(main())
