"""The live page of a watch in Chromium."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from browser_pages import clean

from grainmotion.report.watch_page import REFRESH_SECONDS, WatchPage, WatchRow, write_watch_page


@pytest.mark.browser
def test_live_page_of_a_watch_needs_nothing_else(chromium, tmp_path):
    """It shows names as they are, loads itself again while the watch goes on, and asks for no other file."""
    name, reason = "load <b>2</b> & 3", "the radiographs are cut off"
    waiting = WatchRow("load-1", "arriving", "", "2 of 4", None, "", "", float("nan"), float("nan"), "", None, None)
    failed = replace(waiting, name=name, phase="error", message=reason)
    page = WatchPage("experiment.toml", str(tmp_path), [waiting, failed], ["a note"])
    write_watch_page(tmp_path / "ended.html", replace(page, ended="ended: 2 states tracked"))
    with clean(chromium, tmp_path / "ended.html") as shown:
        text = shown.locator("body").inner_text()
        html = shown.content()
    assert all(part in text for part in (name, reason, "2 of 4", "a note", "ended: 2 states tracked"))
    assert not re.findall(r"(?:src|href)=|url\(|<script", html)
    assert "http-equiv" not in html
    write_watch_page(tmp_path / "watch.html", page)
    assert f'http-equiv="refresh" content="{REFRESH_SECONDS}"' in (tmp_path / "watch.html").read_text(encoding="utf-8")
