"""Radiographs, shadows and slices on the page in Chromium, against Python's numbers and projections."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import radiographs_example
from browser_pages import clean
from playwright.sync_api import Browser, Page, expect
from radiographs_example import PANEL

from grainmotion.report import write_report

pytestmark = pytest.mark.browser
CASES = [("cone", "bottom"), ("cone", "top"), ("parallel", "bottom")]


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[tuple[str, str], Path]:
    """Reports by beam and first row."""
    folder, paths = tmp_path_factory.mktemp("radiographs"), {}
    for beam, first_row in CASES:
        paths[beam, first_row] = folder / f"{beam}-{first_row}.html"
        write_report(paths[beam, first_row], radiographs_example.report(beam, first_row))
    return paths


@pytest.fixture(scope="module")
def opened_page(chromium: Browser, pages) -> Iterator[Page]:
    """The report of a cone beam, opened once: starting the 3-D viewer takes longer than most tests."""
    with clean(chromium, pages["cone", "bottom"]) as opened:
        opened.locator("#radiographs[data-view='0']").wait_for()
        opened.locator("#slices[data-ready]").wait_for()
        yield opened


@pytest.fixture
def page(opened_page: Page) -> Page:
    """The report with its last state's first view on the page, all as at first but the divider."""
    opened_page.evaluate("gm.app.setGrain(null); gm.app.setState(1)")
    opened_page.get_by_label("two with a divider").check(force=True)
    for side, kind in (("left", "measured"), ("right", "simulated")):
        opened_page.locator(".sides").get_by_label(side).select_option(kind)
    opened_page.get_by_role("radio", name="view 0").check(force=True)
    opened_page.get_by_role("button", name="reset contrast").click()
    opened_page.get_by_role("button", name="whole").click()
    opened_page.locator("#radiographs[data-view='0']").wait_for()
    return opened_page


def own_rows(shown: np.ndarray, first_row: str) -> np.ndarray:
    """Rows of the radiograph of shown rows (0 uppermost)."""
    return PANEL[0] - 1 - shown if first_row == "bottom" else shown


@pytest.mark.parametrize(("beam", "first_row"), CASES)
def test_projection_pixels_and_footprints_are_those_of_python(chromium, pages, beam, first_row):
    data = radiographs_example.report(beam, first_row)
    state, motions = data.states[1], data.states[1].motions
    points = np.random.default_rng(0).uniform(-2, 2, (20, 3))
    with clean(chromium, pages[beam, first_row]) as page:
        projected = page.evaluate(
            "points => gm.app.data.states[1].views.map(v => points.map(gm.projection.camera(v)))", points.tolist()
        )
        outlines = page.evaluate(
            "async () => { const f = await gm.footprints.of(gm.app, 1);"
            "return gm.app.data.states[1].views.map(v => [0, 1, 2].map(row => f.outline(row, v))); }"
        )
        measured = page.evaluate(
            "async () => { const i = await gm.radiographImages.of(gm.app.data.states[1].views[0]);"
            "return [...i.measured].map(x => Number.isNaN(x) ? null : x); }"
        )
    projected = np.array(projected)
    found = np.stack([own_rows(projected[..., 1], first_row), projected[..., 0]], axis=-1)
    np.testing.assert_allclose(found, state.geometry.project_points(points), atol=1e-6)

    image = np.array(measured, float).reshape(PANEL)[:: -1 if first_row == "bottom" else 1]
    np.testing.assert_allclose(image, state.measured[0], atol=0.012)

    for view in range(2):
        assert outlines[view][2] == []  # it has no motion
        for row, label in enumerate(radiographs_example.LABELS[:2]):
            columns, shown_rows = np.array(outlines[view][row]).T
            outline = np.stack([own_rows(shown_rows, first_row), columns], axis=1)
            places = state.geometry.project_points(radiographs_example.voxels(label, motions))[view]
            for direction in ([1, 0], [0, 1], [0.6, 0.8], [0.8, -0.6]):  # as far as the grain's voxels, all around
                reach = [[(p @ direction).min(), (p @ direction).max()] for p in (outline, places)]
                np.testing.assert_allclose(*reach, atol=1.0)


class TestRadiographs:
    def test_divider_is_dragged_and_moved_by_keys(self, page):
        divider = page.get_by_role("slider", name="divider")
        divider.scroll_into_view_if_needed()
        divider.hover()
        page.mouse.down()
        box = page.locator(".pane").bounding_box()
        page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + box["height"] / 2)
        page.mouse.up()
        expect(divider).to_have_attribute("aria-valuenow", "80")
        divider.press("ArrowLeft")
        expect(divider).to_have_attribute("aria-valuenow", "78")
        divider.press("Home")
        expect(divider).to_have_attribute("aria-valuenow", "0")
        for _ in range(5):
            divider.press("Shift+ArrowRight")
        expect(divider).to_have_attribute("aria-valuenow", "50")

    def test_divider_has_one_image_on_its_left_and_the_other_on_its_right(self, page):
        """Left of it the residual's colours, right of it shades of grey."""
        page.locator(".sides").get_by_label("left").select_option("residual")
        assert coloured(page, 0.25)
        assert not coloured(page, 0.75)
        page.locator(".sides").get_by_label("right").select_option("residual")
        page.locator(".sides").get_by_label("left").select_option("simulated")
        assert coloured(page, 0.75)
        assert not coloured(page, 0.25)

    def test_three_images_move_together(self, page):
        page.get_by_label("all three").check(force=True)
        expect(page.locator(".pane canvas")).to_have_count(3)
        before = [pixels(page, k) for k in range(3)]
        page.get_by_role("button", name="zoom in").click()
        after = [pixels(page, k) for k in range(3)]
        assert all(a != b for a, b in zip(before, after, strict=True))
        page.get_by_role("button", name="whole").click()
        assert [pixels(page, k) for k in range(3)] == before

    def test_keys_zoom_and_move(self, page):
        canvas = page.locator(".pane canvas")
        before = pixels(page)
        canvas.focus()
        for _ in range(6):
            page.keyboard.press("+")
        seen = [before]
        for key in ("+", "ArrowRight", "ArrowDown", "-"):
            page.keyboard.press(key)
            assert pixels(page) not in seen
            seen.append(pixels(page))
        page.keyboard.press("0")
        assert pixels(page) == before

    def test_views_are_picked_by_mouse_and_keys(self, page):
        second = page.get_by_role("radio", name="view 1")
        second.check(force=True)
        expect(page.locator("#radiographs")).to_have_attribute("data-view", "1")
        expect(page.locator("#radiograph-note")).to_contain_text("view 1: 56 × 70 pixels, every pixel of the panel")
        second.press("ArrowLeft")
        expect(page.locator("#radiographs")).to_have_attribute("data-view", "0")

    def test_pixel_under_the_pointer_is_read(self, page):
        """At the centre of a grain's footprint: row and column of the radiograph as measured, and its values."""
        state = radiographs_example.report().states[1]
        row, column = grain_pixel(0)
        x, y = shown_at(page, row, column)
        page.mouse.move(x, y)
        text = page.locator("#radiographs output.readout").text_content()
        assert text.startswith(f"row {row}, column {column}: measured ")
        value = float(text.split("measured ")[1].split(",")[0])
        assert value == pytest.approx(state.measured[0, row, column], abs=0.012)
        page.mouse.move(*shown_at(page, row, 66))
        assert "measured masked" in page.locator("#radiographs output.readout").text_content()

    def test_click_selects_the_grain_and_its_outline_is_drawn(self, page):
        before = pixels(page)
        page.mouse.click(*shown_at(page, *grain_pixel(1)))
        assert page.evaluate("gm.app.grain") == radiographs_example.LABELS[1]
        assert pixels(page) != before
        page.mouse.click(*shown_at(page, 1, 1))
        assert page.evaluate("gm.app.grain") is None

    def test_contrast_changes_the_image_and_is_reset(self, page):
        before = pixels(page)
        page.get_by_label("white at").fill("1")
        assert pixels(page) != before
        page.get_by_role("button", name="reset contrast").click()
        assert pixels(page) == before

    def test_state_brings_its_own_radiographs(self, page):
        before = pixels(page)
        page.evaluate("gm.app.setState(0)")
        page.wait_for_function("before => document.querySelector('.pane canvas').toDataURL() !== before", arg=before)


class TestShadows:
    def test_selected_grain_has_three_cut_outs_a_view(self, page):
        page.evaluate(f"gm.app.setGrain({radiographs_example.LABELS[0]})")
        expect(page.locator("#shadows .shadow canvas")).to_have_count(6)
        cut = page.get_by_role("img", name="residual shadow of grain 3, view 1")
        expect(cut).to_be_visible()
        page.evaluate("gm.app.setGrain(null)")
        expect(page.locator("#shadows canvas")).to_have_count(0)

    def test_grain_without_a_place_is_said_to_have_none(self, page):
        page.evaluate(f"gm.app.setGrain({radiographs_example.LABELS[2]})")
        expect(page.locator("#shadows")).to_contain_text("no place in this state")
        page.evaluate("gm.app.setState(0)")
        expect(page.locator("#shadows .shadow canvas")).to_have_count(6)


class TestSlices:
    def test_sliders_follow_the_selected_grain(self, page):
        page.evaluate(f"gm.app.setGrain({radiographs_example.LABELS[1]})")
        center = radiographs_example.voxels(radiographs_example.LABELS[1]).mean(axis=0)
        for axis, place in zip("xyz", center, strict=True):
            slider = page.get_by_label(f"place of the slice along {axis}")
            shown = float(slider.get_attribute("aria-valuetext").split()[2].replace("−", "-"))
            assert shown == pytest.approx(place, abs=0.12)

    def test_click_on_a_slice_selects_its_grain(self, page):
        page.evaluate(f"gm.app.setGrain({radiographs_example.LABELS[0]})")
        canvas = page.locator("#slices canvas").first  # across z, x to the right and y upwards
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        page.evaluate("gm.app.setGrain(null)")
        page.mouse.click(box["x"] + box["width"] * 12.5 / 48, box["y"] + box["height"] * (1 - 20.5 / 44))
        assert page.evaluate("gm.app.grain") == radiographs_example.LABELS[0]


@pytest.mark.parametrize(("width", "dark"), [(360, True), (1400, False)])
def test_nothing_is_wider_than_the_window(chromium, pages, screenshots, width, dark):
    """With screenshots, to be looked at."""
    name = "dark" if dark else "light"
    with clean(chromium, pages["cone", "bottom"], width=width, dark=dark) as page:
        page.locator("#radiographs[data-view='0']").wait_for()
        page.evaluate(f"gm.app.setGrain({radiographs_example.LABELS[1]})")
        expect(page.locator("#shadows .shadow canvas")).to_have_count(6)
        for part in ("#radiographs", "#shadows", "#slices"):
            page.locator(part).screenshot(path=screenshots / f"{part[1:]}-{name}-{width}.png")
            assert page.locator(part).evaluate("e => e.scrollWidth <= e.clientWidth + 1"), part


def pixels(page: Page, pane: int = 0) -> str:
    """All pixels of a pane, as an address."""
    return page.locator(".pane canvas").nth(pane).evaluate("canvas => canvas.toDataURL()")


def coloured(page: Page, place: float) -> bool:
    """Whether a column of the canvas, at a share of its width, has colours other than grey."""
    return page.locator(".pane canvas").evaluate(
        "(c, place) => { const d = c.getContext('2d').getImageData(Math.round(place * c.width), 0, 1, c.height).data;"
        "for (let k = 0; k < d.length; k += 4) if (Math.abs(d[k] - d[k + 2]) > 30) return true; return false; }",
        place,
    )


def grain_pixel(row: int) -> tuple[int, int]:
    """Row and column of the radiograph at the centre of a grain in the last state's first view."""
    state = radiographs_example.report().states[1]
    center = state.motions.centers[row] + state.motions.translations[row]
    r, c = np.rint(state.geometry.project_points(center)[0, 0]).astype(int)
    return int(r), int(c)


def shown_at(page: Page, row: int, column: int) -> tuple[float, float]:
    """Place in the window of a pixel of the first view, whose first row is the lowest, shown as a whole."""
    page.locator(".pane canvas").scroll_into_view_if_needed()
    box = page.locator(".pane canvas").bounding_box()
    scale = min(box["width"] / PANEL[1], box["height"] / PANEL[0])
    x = (box["width"] - scale * PANEL[1]) / 2 + (column + 0.5) * scale
    y = (box["height"] - scale * PANEL[0]) / 2 + (PANEL[0] - 1 - row + 0.5) * scale
    return box["x"] + x, box["y"] + y
