"""The report's HTML page: its content, escaping of text, and that it loads nothing from the network."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import example
import numpy as np
import pytest

from grainmotion.model.finding import Finding, Level
from grainmotion.model.motions import Motions, Status
from grainmotion.report import ReportData, StateReport, write_report


class Page(HTMLParser):
    """The page's elements, its text by table cell, and its scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.tables: list[list[list[str]]] = []
        self.scripts: list[str] = []
        self.words: list[str] = []
        self._inside: str | None = None
        self._cell = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._inside = tag if tag in ("script", "style") else None
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self._cell = True
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._inside = None
        if tag == "table":
            self._cell = False

    def handle_data(self, text):
        if self._inside == "script":
            self.scripts[-1] += text
        elif self._inside is None:
            self.words.append(text)
            if self._cell:
                self.tables[-1][-1][-1] += text

    def count(self, tag: str, **attributes: str) -> int:
        return sum(t == tag and attributes.items() <= a.items() for t, a in self.elements)


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, example.data())
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(source) -> Page:
    return Page(source)


def write_and_parse(tmp_path, data: ReportData) -> Page:
    """Write the report and parse its page."""
    write_report(tmp_path / "report.html", data)
    return Page((tmp_path / "report.html").read_text(encoding="utf-8"))


class TestContent:
    def test_counts_by_status_that_occur(self, page):
        _, header, *rows = page.tables[-1]
        present = [s.value for s in list(Status)[:5]]
        assert header[2:7] == present
        assert rows[0][:9] == ["step-01", "6", "2", "2", "2", "1", "1", "1", "1"]

    def test_versions_and_citation(self, page):
        text = "".join(page.words)
        assert "10.1007/s11340-017-0263-5" in text
        assert "numba" in text


class TestSafety:
    def test_text_of_the_user_is_escaped(self, page):
        assert not any("onerror" in attributes for _, attributes in page.elements)
        assert page.count("img", src="x") == 0
        assert all("<img" not in script for script in page.scripts[:1])

    def test_page_loads_nothing_from_the_network(self, page):
        for tag, attributes in page.elements:
            for name in ("src", "srcset", "data", "action", "poster"):
                if attributes.get(name):
                    assert attributes[name].startswith("data:"), (tag, attributes)
            assert tag not in ("link", "iframe", "object", "embed", "base")
            if tag != "a" and attributes.get("href"):
                assert attributes["href"].startswith("#")
        policy = next(a["content"] for t, a in page.elements if a.get("http-equiv"))
        assert policy.startswith("default-src 'none'")
        assert "http" not in policy

    def test_styles_load_nothing_from_the_network(self, source):
        for style in re.findall(r"<style.*?</style>", source, flags=re.DOTALL):
            assert "@import" not in style
            assert not re.search(r"url\((?!#)", style)

    def test_failed_write_keeps_the_old_report(self, tmp_path, monkeypatch):
        path = tmp_path / "report.html"
        path.write_text("older")
        monkeypatch.setattr("grainmotion.report.page._version", lambda package: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_report(path, example.data())
        assert path.read_text() == "older"
        assert list(tmp_path.iterdir()) == [path]


class TestMissingData:
    def test_report_without_states(self, tmp_path):
        assert "No later state" in "".join(write_and_parse(tmp_path, ReportData("reference only")).words)

    def test_state_without_grains_costs_or_finite_pixels(self, tmp_path):
        nothing = Motions.identity(np.zeros(0, int), np.zeros((0, 3)))
        images = np.full((1, 4, 5), np.nan)
        page = write_and_parse(tmp_path, ReportData("x", states=(StateReport("s", images, images, nothing, 0.1),)))
        assert page.tables[-1][2][1] == "0"

    def test_grains_that_were_not_fitted(self, tmp_path):
        still = Motions.identity(np.arange(1, 4), np.eye(3))
        images = np.zeros((1, 4, 5))
        page = write_and_parse(tmp_path, ReportData("x", states=(StateReport("s", images, images, still, 0.1),)))
        assert page.tables[-1][2][1:5] == ["3", "0", "0", "3"]


class TestFindings:
    FOUND = (
        Finding(Level.NOTE, "pixels", "reference", "3 pixels masked"),
        Finding(Level.ERROR, "common-cause", "states.a", f"6 of 6 fail {example.MARKUP}", "gain 0.8", "check them"),
        Finding(Level.WARNING, "views", "states.b", "views contradict each other"),
    )

    def test_stand_first_and_worst_first(self, tmp_path):
        page = write_and_parse(tmp_path, replace(example.data(), findings=self.FOUND))
        assert next(a["id"] for t, a in page.elements if t == "section") == "findings"
        levels = [a.get("class") for t, a in page.elements if t == "li"][:3]
        assert levels == ["finding error", "finding warning", "finding note"]
        text = " ".join("".join(page.words).split())
        assert f"error states.a: 6 of 6 fail {example.MARKUP} (gain 0.8)" in text
        assert "What to do: check them" in text
        assert page.count("img", src="x") == 0

    def test_a_page_without_findings_says_so(self, page):
        assert page.count("ul", **{"class": "findings"}) == 0
        assert "found nothing to report" in " ".join("".join(page.words).split())
