"""The report's page in Chromium: no script errors, no request, and each control does what it says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import example
import numpy as np
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


def test_page_starts(report):
    expect(report.locator("html")).to_have_attribute("data-ready", "yes")


def test_arrays_are_decoded_by_the_page(report):
    """Row by row what Python put there, NaN where a grain has no motion; and what follows from the columns."""
    ux, u = report.evaluate(
        "async () => [[...await gm.app.column(0, 'ux')].map(String), [...await gm.app.column(0, 'u')].map(String)]"
    )
    translations = example.motions().translations
    np.testing.assert_allclose([float(x) for x in ux], translations[:, 0], rtol=1e-6, atol=0.5e-6)
    np.testing.assert_allclose([float(x) for x in u], np.linalg.norm(translations, axis=1), rtol=1e-6, atol=0.9e-6)


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
