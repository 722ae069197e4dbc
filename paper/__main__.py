"""Run studies and write their sections: ``python -m paper [STUDY ...]``; all of them without a name."""

from __future__ import annotations

import argparse
import importlib
import time

from paper import page

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


def main() -> None:
    """Each study is a module here with ``study() -> Section``."""
    parser = argparse.ArgumentParser(prog="python -m paper", description="Rerun the paper's results.")
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(STUDIES)}; all if none is named")
    chosen = parser.parse_args().studies or STUDIES
    unknown = sorted(set(chosen) - set(STUDIES))
    if unknown:
        parser.error(f"no study {', '.join(unknown)}; there are {', '.join(STUDIES)}")
    for name in chosen:
        start, cpu = time.perf_counter(), time.process_time()
        print(f"{name} ...", flush=True)
        page.write(name, importlib.import_module(f"paper.{name}").study())
        print(f"{name}: {time.perf_counter() - start:.0f} s, {time.process_time() - cpu:.0f} CPU s", flush=True)


if __name__ == "__main__":
    main()
