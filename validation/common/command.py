"""The command of a package of studies: run those that are named and write their sections."""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Sequence

from validation.common.page import Page


def run(page: Page, names: Sequence[str], description: str) -> None:
    """Each study is a module of the page's package with ``study() -> Section``."""
    parser = argparse.ArgumentParser(prog=f"python -m validation.{page.name}", description=description)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(names)}; all if none is named")
    chosen = parser.parse_args().studies or names
    unknown = sorted(set(chosen) - set(names))
    if unknown:
        parser.error(f"no study {', '.join(unknown)}; there are {', '.join(names)}")
    for name in chosen:
        start, cpu = time.perf_counter(), time.process_time()
        print(f"{name} ...", flush=True)
        page.write(name, importlib.import_module(f"validation.{page.name}.{name}").study())
        print(f"{name}: {time.perf_counter() - start:.0f} s, {time.process_time() - cpu:.0f} CPU s", flush=True)
