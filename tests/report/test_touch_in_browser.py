"""The page under fingers in Chromium: taps choose grains, one finger turns or moves a picture, two zoom it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import radiographs_example
from browser_pages import clean
from playwright.sync_api import Browser, Locator, Page, expect

from grainmotion.report import write_report

pytestmark = pytest.mark.browser
EYE = "gm.viewer.shown.view.where()"  # azimuth and elevation, degrees, and distance, mm


@pytest.fixture(scope="module")
def page(chromium: Browser, tmp_path_factory) -> Iterator[Page]:
    path = tmp_path_factory.mktemp("touch") / "report.html"
    write_report(path, radiographs_example.report("cone", "bottom"))
    with clean(chromium, path, width=600, height=1000, touch=True) as opened:
        expect(opened.locator("#viewer[data-drawn=yes]")).to_be_visible()
        opened.locator("#radiographs[data-view='0']").wait_for()
        yield opened


def fingers(page: Page, *moments: list[tuple[float, float]]) -> None:
    """Put fingers down at the first moment's places in the window, move them to the others', and lift them."""
    session = page.context.new_cdp_session(page)
    for kind, places in zip(
        ["touchStart", *["touchMove"] * (len(moments) - 1), "touchEnd"], [*moments, []], strict=True
    ):
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    session.detach()


def middle(canvas: Locator) -> tuple[float, float]:
    """The middle of a canvas in the window, scrolled into view."""
    canvas.evaluate("c => c.scrollIntoView({ behavior: 'instant', block: 'center' })")
    box = canvas.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_one_finger_turns_the_grains_and_chooses_none(page):
    x, y = middle(page.locator("#viewer canvas"))
    before = page.evaluate(EYE)
    fingers(page, [(x, y)], [(x + 40, y)], [(x + 80, y)])
    azimuth, _, distance = np.subtract(page.evaluate(EYE), before)
    assert abs(azimuth) > 5
    assert abs(distance) < 1e-6 * before[2]
    assert page.evaluate("gm.app.grain") is None


def test_two_fingers_zoom_the_grains(page):
    x, y = middle(page.locator("#viewer canvas"))
    before = page.evaluate(EYE)[2]
    fingers(page, *[[(x - apart, y), (x + apart, y)] for apart in (40, 60, 80)])
    assert page.evaluate(EYE)[2] < 0.7 * before
    assert page.evaluate("gm.app.grain") is None
    page.get_by_role("button", name="Reset", exact=True).click()


def test_a_tap_that_wavers_chooses_the_grain(page):
    canvas = page.locator("#viewer canvas")
    left, top = np.subtract(middle(canvas), np.array([canvas.bounding_box()[k] for k in ("width", "height")]) / 2)
    width, height = (canvas.bounding_box()[k] for k in ("width", "height"))
    u, v = page.evaluate(
        "(() => { const { grains, view } = gm.viewer.shown;"
        "const v = new THREE.Vector3(...grains.places.subarray(0, 3)).project(view.camera); return [v.x, v.y]; })()"
    )
    x, y = left + (u + 1) / 2 * width, top + (1 - v) / 2 * height
    fingers(page, [(x, y)], [(x + 4, y + 4)])
    assert page.evaluate("gm.app.grain") == radiographs_example.LABELS[0]
    page.evaluate("gm.app.setGrain(null)")


def test_two_fingers_zoom_a_radiograph_and_one_moves_it(page):
    canvas = page.locator(".pane canvas")
    x, y = middle(canvas)
    pixels = "c => c.toDataURL()"
    whole = canvas.evaluate(pixels)
    x += 60  # beside the divider's handle
    fingers(page, *[[(x - apart, y - 100), (x + apart, y - 100)] for apart in (20, 40, 60)])
    near = canvas.evaluate(pixels)
    assert near != whole
    fingers(page, [(x, y - 100)], [(x + 30, y - 130)], [(x + 50, y - 150)])
    moved = canvas.evaluate(pixels)
    assert moved not in (near, whole)
    assert page.evaluate("gm.app.grain") is None
    fingers(page, *[[(x - apart, y - 100), (x + apart, y - 100)] for apart in (100, 40, 10)])
    assert canvas.evaluate(pixels) == whole
