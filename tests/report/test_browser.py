"""The report's page in Chromium: no script errors, sorting, enlarging images, drawing arrows; a watch's live page."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import example
import pytest

from grainmotion.report import write_report
from grainmotion.report.watch_page import REFRESH_SECONDS, WatchPage, WatchRow, write_watch_page

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--virtual-time-budget=10000",
]

CLICKS = """
<script>
window.addEventListener("load", () => setTimeout(() => {
  const table = document.querySelector(".grains"), heads = table.tHead.rows[1].cells;
  const read = (column) => Array.from(table.tBodies[0].rows, (row) => row.cells[column].textContent).join(";");
  const shown = { open: read(0) };
  heads[8].click(); shown.wx_up = read(8);
  heads[8].click(); shown.wx_down = read(8);
  heads[1].click(); shown.status = read(1);
  heads[0].querySelector("button").click(); shown.label = read(0);
  shown.sorted = heads[0].getAttribute("aria-sort");
  document.querySelector(".trio").click();
  shown.zoomed = String(document.querySelectorAll("dialog[open] img").length);
  document.getElementById("zoom").click();
  shown.closed = String(document.querySelectorAll("dialog[open]").length);
  const kind = document.getElementById("arrows-kind");
  kind.selectedIndex = 2; kind.dispatchEvent(new Event("change"));
  shown.canvas = String(document.querySelectorAll("#arrows-plot canvas").length);
  shown.note = document.getElementById("arrows-note").textContent;
  for (const [key, value] of Object.entries(shown)) document.body.setAttribute("data-" + key.replace("_", "-"), value);
}, 1500));
</script>
"""


def open_in_chromium(page: Path, profile: Path) -> tuple[str, list[str]]:
    """The page's DOM after its scripts have run, and the lines of the console."""
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.fail("chromium is not on the PATH: install chromium (apt-get install chromium)")
    command = [chromium, *FLAGS, f"--user-data-dir={profile}", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    return done.stdout, re.findall(r"CONSOLE[:(]\d+\)?\] (.*)", done.stderr)


@pytest.fixture(scope="module")
def clicked_page(tmp_path_factory) -> tuple[dict[str, str], list[str]]:
    """Values on the page after each click, and the lines of the console."""
    folder = tmp_path_factory.mktemp("browser")
    write_report(folder / "report.html", example.data())
    text = (folder / "report.html").read_text(encoding="utf-8")
    (folder / "clicked.html").write_text(text.replace("</body>", CLICKS + "</body>"), encoding="utf-8")
    dom, console = open_in_chromium(folder / "clicked.html", folder / "profile")
    body = re.search(r"<body([^>]*)>", dom)
    assert body is not None
    return dict(re.findall(r'data-([\w-]+)="([^"]*)"', body.group(1))), console


def cell_numbers(text: str) -> list[float]:
    """Numbers of the cells of a column; cells without a value are left out."""
    return [float(cell.replace("−", "-")) for cell in text.split(";") if cell != "–"]


@pytest.mark.browser
class TestInChromium:
    def test_console_has_no_errors(self, clicked_page):
        shown, console = clicked_page
        assert shown, console
        assert not [line for line in console if re.search("Uncaught|Error|Refused|violates|Failed", line)]

    def test_rows_are_first_sorted_by_label(self, clicked_page):
        assert clicked_page[0]["open"] == "1;11;21;31;41;51"

    def test_clicks_on_a_heading_sort_up_and_then_down(self, clicked_page):
        shown = clicked_page[0]
        up, down = cell_numbers(shown["wx-up"]), cell_numbers(shown["wx-down"])
        assert len(up) == len(down) == 5
        assert up == sorted(up)
        assert down == sorted(down, reverse=True)
        assert shown["wx-up"].endswith("–")
        assert shown["wx-down"].endswith("–")

    def test_status_and_label_columns_are_sorted(self, clicked_page):
        shown = clicked_page[0]
        assert shown["status"].split(";") == sorted(shown["status"].split(";"))
        assert shown["label"] == "1;11;21;31;41;51"
        assert shown["sorted"] == "ascending"

    def test_images_of_a_view_are_enlarged_and_closed(self, clicked_page):
        assert clicked_page[0]["zoomed"] == "3"
        assert clicked_page[0]["closed"] == "0"

    def test_arrows_are_drawn(self, clicked_page):
        assert int(clicked_page[0]["canvas"]) >= 1
        assert clicked_page[0]["note"].startswith("arrows ×")


@pytest.mark.browser
def test_live_page_of_a_watch_needs_nothing_else(tmp_path):
    """It shows names as they are, loads itself again while the watch goes on, and asks for no other file."""
    name, reason = "load <b>2</b> & 3", "the radiographs are cut off"
    waiting = WatchRow("load-1", "arriving", "", "2 of 4", None, "", "", float("nan"), float("nan"), "", None, None)
    failed = replace(waiting, name=name, phase="error", message=reason)
    page = WatchPage("experiment.toml", str(tmp_path), [waiting, failed], ["a note"])
    write_watch_page(tmp_path / "ended.html", replace(page, ended="ended: 2 states tracked"))
    dom, console = open_in_chromium(tmp_path / "ended.html", tmp_path / "profile")
    assert "load &lt;b&gt;2&lt;/b&gt; &amp; 3" in dom
    assert all(text in dom for text in (reason, "2 of 4", "a note", "ended: 2 states tracked"))
    assert not console
    assert not re.findall(r"(?:src|href)=|url\(|<script", dom)
    assert "http-equiv" not in dom
    write_watch_page(tmp_path / "watch.html", page)
    assert f'http-equiv="refresh" content="{REFRESH_SECONDS}"' in (tmp_path / "watch.html").read_text(encoding="utf-8")
