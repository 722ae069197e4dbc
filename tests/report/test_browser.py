"""The report's page in Chromium: no script errors, sorting, enlarging images, drawing arrows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import example
import pytest
from browser_pages import clean, opened
from playwright.sync_api import Browser, Page, expect

from grainmotion.report import write_report

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def report_path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, example.data())
    return path


@pytest.fixture
def report(chromium: Browser, report_path: Path) -> Iterator[Page]:
    """The opened report; at the end of a test it must have reported no error and asked for nothing."""
    with clean(chromium, report_path) as page:
        yield page


def cells(page: Page, column: int) -> list[str]:
    """Texts of a column of the first table of grains, as they are ordered now."""
    return page.locator(".grains").first.locator(f"tbody td:nth-child({column + 1})").all_text_contents()


def numbers(texts: list[str]) -> list[float]:
    """Numbers of cells; cells without a value are left out."""
    return [float(text.replace("−", "-")) for text in texts if text != "–"]


class TestTable:
    def test_clicks_on_a_heading_sort_up_and_then_down(self, report):
        assert cells(report, 0) == ["1", "11", "21", "31", "41", "51"]
        head = report.locator(".grains").first.locator("thead tr:last-child th").nth(8)
        head.click()
        up = cells(report, 8)
        head.click()
        down = cells(report, 8)
        assert len(numbers(up)) == len(numbers(down)) == 5
        assert numbers(up) == sorted(numbers(up))
        assert numbers(down) == sorted(numbers(down), reverse=True)
        assert up[-1] == down[-1] == "–"

    def test_status_and_label_columns_are_sorted(self, report):
        heads = report.locator(".grains").first.locator("thead tr:last-child th")
        heads.nth(1).click()
        assert cells(report, 1) == sorted(cells(report, 1))
        heads.nth(0).get_by_role("button").press("Enter")
        assert cells(report, 0) == ["1", "11", "21", "31", "41", "51"]
        expect(heads.nth(0)).to_have_attribute("aria-sort", "ascending")


def test_images_of_a_view_are_enlarged_and_closed(report):
    report.locator(".trio").first.click()
    expect(report.locator("dialog[open] img")).to_have_count(3)
    report.locator("#zoom").click()
    expect(report.locator("dialog[open]")).to_have_count(0)


def test_arrows_are_drawn(report):
    report.locator("#arrows-kind").select_option(index=2)
    expect(report.locator("#arrows-plot canvas").first).to_be_attached()
    expect(report.locator("#arrows-note")).to_contain_text("arrows ×")


def test_errors_and_requests_of_a_page_are_noticed(chromium, tmp_path):
    """The check of all other tests here can fail."""
    other = tmp_path / "other.png"
    other.write_bytes(b"")
    page = tmp_path / "page.html"
    page.write_text(
        f'<img src="{other.as_uri()}"><img src="data:image/gif;base64,R0lGODlhAQABAAAAACw="><script>x.y</script>'
    )
    with opened(chromium, page) as (_, complaints):
        assert complaints.requests == [other.as_uri()]
        assert [line for line in complaints.console if "x is not defined" in line]
