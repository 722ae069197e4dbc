"""Command line of a package of studies: run those that are named and write their sections."""

from __future__ import annotations

import argparse
import importlib
import inspect
import time
from collections.abc import Sequence

from validation.common.page import Page


def run(page: Page, names: Sequence[str], description: str) -> None:
    """Each study is a module of the page's package with ``study() -> Section``, or ``study(samples: int = ...)``."""
    parser = argparse.ArgumentParser(prog=f"python -m validation.{page.name}", description=description)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(names)}; all if none is named")
    parser.add_argument("--samples", type=int, help="a quick look at so few samples: printed, not written to the page")
    options = parser.parse_args()
    chosen = options.studies or names
    unknown = sorted(set(chosen) - set(names))
    if unknown:
        parser.error(f"no study {', '.join(unknown)}; there are {', '.join(names)}")
    for name in chosen:
        start, cpu = time.perf_counter(), time.process_time()
        print(f"{name} ...", flush=True)
        study = importlib.import_module(f"validation.{page.name}.{name}").study
        if options.samples is None:
            page.write(name, study())
        elif "samples" in inspect.signature(study).parameters:
            print(study(samples=options.samples).text)
        else:
            parser.error(f"{name} takes no number of samples")
        print(f"{name}: {time.perf_counter() - start:.0f} s, {time.process_time() - cpu:.0f} CPU s", flush=True)
