"""What the 3-D viewer of the report costs: size of the page, triangles and draw calls of a frame, time of a frame.

    python -m validation.benchmarks.report_frames [--grains 500 5000] [--frames 40]

Opens reports of simulated grains in chromium without a window and turns them.  Time of the page's own scripts for a
frame (what one core of any machine has to do) is measured apart from drawing, which chromium does in software where
there is no graphics card; its CPU time is that of all processes of the browser, on all cores.  Writes
``validation/benchmarks/results/report_frames.md``; ends with code 1 if a bar is missed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import psutil
from playwright.sync_api import Page, sync_playwright
from tests.report.many_grains_report import many_grains_report

from grainmotion.report import write_report
from grainmotion.report.surfaces import MAX_TRIANGLES
from validation.benchmarks.peers.environment import machine

RESULT = Path(__file__).parent / "results" / "report_frames.md"
WINDOW = {"width": 1600, "height": 1000}
MAX_PAGE_MB, MAX_CALLS, MAX_SCRIPT_MS = 15.0, 4, 4.0
"""Bars: size of the page, draw calls of a frame, time of the page's scripts for a frame (of 33 ms)."""
OUTPUT_TRIANGLES_A_SECOND = 400e6
"""Triangles that integrated graphics of 2017 (Intel UHD 620: about 1 GHz, a triangle in two cycles) set up."""
TURN = """async ([frames, coarse]) => {
  const { canvas, view, scene } = gm.viewer.shown, { renderer } = canvas, gl = renderer.getContext();
  const pixel = new Uint8Array(4), script = [], whole = [];
  gm.viewer.shown.grains.setCoarse(coarse);
  renderer.setPixelRatio(coarse ? 0.6 : 1);
  for (let i = 0; i < frames; i++) {
    const start = performance.now();
    view.turn(360 / frames, 0);
    renderer.render(scene, view.camera);
    script.push(performance.now() - start);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits for the drawing
    whole.push(performance.now() - start);
  }
  const median = (list) => list.sort((a, b) => a - b)[list.length >> 1];
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return { script: median(script), whole: median(whole), calls: renderer.info.render.calls,
    triangles: renderer.info.render.triangles, pixels: [gl.drawingBufferWidth, gl.drawingBufferHeight],
    renderer: gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) };
}"""


@dataclass(frozen=True)
class Row:
    """Figures of one page; times in ms, ``cpu_ms`` the CPU time of a frame on all cores,
    ``few_`` that of the frames which slow machines draw while the view turns."""

    grains: int
    page_mb: float
    ready_s: float
    triangles: int
    calls: int
    script_ms: float
    frame_ms: float
    cpu_ms: float
    few_triangles: int
    few_cpu_ms: float
    pixels: tuple[int, int]
    renderer: str

    @property
    def within_bars(self) -> bool:
        """Whether page, draw calls, triangles and scripts stay within their bars."""
        small = self.page_mb <= MAX_PAGE_MB and self.triangles <= 1.01 * MAX_TRIANGLES
        return small and self.calls <= MAX_CALLS and self.script_ms <= MAX_SCRIPT_MS


def measure(count: int, frames: int) -> Row:
    """Write the report of so many grains, open it and turn it once around."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "report.html"
        write_report(path, many_grains_report(count))
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--enable-unsafe-swiftshader"], chromium_sandbox=False
        )
        page = browser.new_page(viewport=WINDOW)
        page.goto(path.as_uri())
        page.wait_for_selector("#viewer[data-drawn=yes]", timeout=120_000)
        ready = float(page.evaluate("performance.now() / 1000"))
        found, cpu = turned(page, frames, False)
        few, few_cpu = turned(page, frames, True)
        size = path.stat().st_size / 1e6
        browser.close()
    return Row(
        count, size, ready, found["triangles"], found["calls"], found["script"], found["whole"], 1000 * cpu / frames,
        few["triangles"], 1000 * few_cpu / frames,
        tuple(found["pixels"]), found["renderer"],
    )  # fmt: skip


def turned(page: Page, frames: int, coarse: bool) -> tuple[dict, float]:
    """What the page measures while it turns, after a few frames that warm up, and CPU seconds of the browser."""
    page.evaluate(TURN, [3, coarse])
    before = browser_seconds()
    found = page.evaluate(TURN, [frames, coarse])
    return found, browser_seconds() - before


def browser_seconds() -> float:
    """CPU time of all processes that this one started."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        try:
            times = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        total += times.user + times.system
    return total


def table(rows: list[Row]) -> str:
    """The page of results."""
    head = (
        "| grains | page (MB) | until drawn (s) | triangles | draw calls | scripts (ms) | frame in software (ms) | "
        "its CPU (ms) | triangles, while turned slowly | its CPU (ms) | integrated graphics, bound by triangles |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|\n"
    )
    lines = [
        f"| {r.grains:,} | {r.page_mb:.1f} | {r.ready_s:.1f} | {r.triangles:,} | {r.calls} | {r.script_ms:.1f} | "
        f"{r.frame_ms:.0f} | {r.cpu_ms:.0f} | {r.few_triangles:,} | {r.few_cpu_ms:.0f} | "
        f"{OUTPUT_TRIANGLES_A_SECOND / r.triangles:,.0f} frames a second |\n"
        for r in rows
    ]
    wide, high = rows[0].pixels
    return (
        "# Frames of the report's 3-D viewer\n\nMade by `python -m validation.benchmarks.report_frames`, three states, "
        f"{wide} × {high} pixels with antialiasing.\n\n{head}{''.join(lines)}\n"
        f"Bars: {MAX_PAGE_MB:.0f} MB, {MAX_CALLS} draw calls, {MAX_TRIANGLES:,} triangles, {MAX_SCRIPT_MS:.0f} ms of "
        "scripts a frame.\n\n"
        "Drawing was done in software, which says nothing of a graphics card. The last column is an estimate, not a "
        f"measurement: integrated graphics of 2017 set up some {OUTPUT_TRIANGLES_A_SECOND / 1e6:.0f} million triangles "
        "a second; a vertex takes three look-ups and some hundred operations, a pixel some forty and no texture, which "
        "is less: triangles are the bound. Where frames come more slowly than every 60 ms while the view turns, the "
        "page draws a third of the pixels and the few triangles of the table until it rests.\n\n"
        f"Renderer: {rows[0].renderer}. Machine: {machine()}.\n"
    )


def main() -> int:
    """Measure, write the table, compare with the bars."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--grains", type=int, nargs="+", default=[6, 500, 5000])
    parser.add_argument("--frames", type=int, default=40)
    arguments = parser.parse_args()
    rows = [measure(count, arguments.frames) for count in arguments.grains]
    text = table(rows)
    print(text)
    RESULT.write_text(text, encoding="utf-8")
    return 0 if all(row.within_bars for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
