"""Settings of all tests: hypothesis draws the same examples in every run; the order of the folders of tests."""

import pytest
from hypothesis import settings

settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")

COMPILING = ("kernels", "backends", "projection")
"""Folders that come first: each file compiles kernels of its own, and later files of all processes find them cached."""
LONG = ("tracking", "workflow", "diagnosis", "physics", "cli", "simulate", "cluster", "validation", "reconstruction")
"""Folders with files of half a minute, which come next: at the end, short files keep all processes busy."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests by folder; within a folder, their order stays."""
    rank = {name: k for k, name in enumerate((*COMPILING, *LONG))}
    items.sort(key=lambda item: rank.get(item.path.parent.name, len(rank)))
