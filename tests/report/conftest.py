"""Chromium for the tests of pages, started once a file of tests: its event loop must not outlive them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

expect.set_options(timeout=20_000)  # ms: a machine that does other things as well takes its time
FLAGS = ["--disable-quic", "--no-first-run", "--enable-unsafe-swiftshader"]  # the last draws 3-D without a card


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """The chromium of the PATH, without a window."""
    path = shutil.which("chromium")
    if path is None:
        pytest.fail("chromium is not on the PATH: install chromium (apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS, chromium_sandbox=False)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def screenshots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder for screenshots: that of the variable GRAINMOTION_SCREENSHOTS, else a temporary one."""
    named = os.environ.get("GRAINMOTION_SCREENSHOTS")
    if named is None:
        return tmp_path_factory.mktemp("screenshots")
    Path(named).mkdir(parents=True, exist_ok=True)
    return Path(named)
