"""Settings of all tests: hypothesis draws the same examples in every run; the order of the folders of tests."""

import sys
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")

COMPILING = ("kernels", "backends", "projection")
"""Folders that come first: each file compiles kernels of its own, and later files of all processes find them cached."""
LONG = (
    "tracking",
    "workflow",
    "diagnosis",
    "physics",
    "cli",
    "simulate",
    "cluster",
    "validation",
    "reconstruction",
    "tests",
)
"""Folders with files of half a minute, which come next (pages of the documentation are tested by files in ``tests``):
at the end, short files keep all processes busy."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests by folder; within a folder, their order stays."""
    rank = {name: k for k, name in enumerate((*COMPILING, *LONG))}
    items.sort(key=lambda item: rank.get(item.path.parent.name, len(rank)))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """A file that runs kernels when it is imported fails: every process would compile them before the first test."""
    before = kernels_that_ran()
    report = yield
    if ran := kernels_that_ran() - before:
        report.outcome = "failed"
        report.longrepr = f"{collector.nodeid} runs {', '.join(sorted(ran))} when it is imported; let a fixture do it"
    return report


def kernels_that_ran() -> set[str]:
    """Names of kernels that were called in this process."""
    modules = [module for name, module in sys.modules.items() if name.startswith("grainmotion.kernels.")]
    return {f"{m.__name__}.{k}" for m in modules for k, v in vars(m).items() if getattr(v, "signatures", None)}
