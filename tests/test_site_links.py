"""The check of the links of the built site finds what is broken, and nothing else."""

from __future__ import annotations

import pytest
from docs import check_links

PAGE = '<a href="{link}">x</a><h2 id="here">y</h2>'


@pytest.fixture
def site(tmp_path):
    (tmp_path / "guide").mkdir()
    (tmp_path / "other.html").write_text('<section id="axes"></section>')
    return tmp_path


def broken(site, link: str) -> bool:
    (site / "guide" / "page.html").write_text(PAGE.format(link=link))
    check_links.parsed.cache_clear()
    return check_links.main(str(site)) == 1


@pytest.mark.parametrize(
    "link",
    ["#here", "../other.html", "../other.html#axes", "https://doi.org/10.1007/s11340-017-0263-5", "mailto:a@b.c"],
)
def test_good_links_pass(site, link):
    assert not broken(site, link)


@pytest.mark.parametrize(
    "link", ["#there", "../another.html", "../other.html#axis", "../../outside.html", "https://nowhere", "htp://a.b"]
)
def test_broken_links_are_found(site, link):
    assert broken(site, link)
