"""The page in a real browser: it runs without an error, sorts, enlarges and draws."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import example
import pytest

from grainmotion.report import write_report

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


def browse(page: Path, profile: Path) -> tuple[str, list[str]]:
    """The page as Chromium leaves it, and what its console says."""
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.fail("chromium is not on the PATH: install chromium (apt-get install chromium)")
    command = [chromium, *FLAGS, f"--user-data-dir={profile}", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    return done.stdout, re.findall(r"CONSOLE[:(]\d+\)?\] (.*)", done.stderr)


@pytest.fixture(scope="module")
def visit(tmp_path_factory) -> tuple[dict[str, str], list[str]]:
    """What the page shows after each click, and the console."""
    folder = tmp_path_factory.mktemp("browser")
    write_report(folder / "report.html", example.data())
    text = (folder / "report.html").read_text(encoding="utf-8")
    (folder / "clicked.html").write_text(text.replace("</body>", CLICKS + "</body>"), encoding="utf-8")
    dom, console = browse(folder / "clicked.html", folder / "profile")
    body = re.search(r"<body([^>]*)>", dom)
    assert body is not None
    return dict(re.findall(r'data-([\w-]+)="([^"]*)"', body.group(1))), console


def numbers(text: str) -> list[float]:
    return [float(cell.replace("−", "-")) for cell in text.split(";") if cell != "–"]


@pytest.mark.browser
class TestInChromium:
    def test_no_error(self, visit):
        shown, console = visit
        assert shown, console
        assert not [line for line in console if re.search("Uncaught|Error|Refused|violates|Failed", line)]

    def test_rows_open_by_label(self, visit):
        assert visit[0]["open"] == "1;11;21;31;41;51"

    def test_a_click_sorts_up_and_another_down(self, visit):
        shown = visit[0]
        up, down = numbers(shown["wx-up"]), numbers(shown["wx-down"])
        assert len(up) == len(down) == 5
        assert up == sorted(up)
        assert down == sorted(down, reverse=True)
        assert shown["wx-up"].endswith("–")
        assert shown["wx-down"].endswith("–")

    def test_words_and_labels_sort_too(self, visit):
        shown = visit[0]
        assert shown["status"].split(";") == sorted(shown["status"].split(";"))
        assert shown["label"] == "1;11;21;31;41;51"
        assert shown["sorted"] == "ascending"

    def test_a_view_enlarges_and_closes(self, visit):
        assert visit[0]["zoomed"] == "3"
        assert visit[0]["closed"] == "0"

    def test_arrows_are_drawn(self, visit):
        assert int(visit[0]["canvas"]) >= 1
        assert visit[0]["note"].startswith("arrows ×")
