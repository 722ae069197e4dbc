"""Check the links of the built site without a network: ``python docs/check_links.py docs/_build/html``.

A link within the site leads to a file of it and, after ``#``, to an element of that page.  A link to the world is only
read: http or https, a host, no blanks.
"""

from __future__ import annotations

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LINKS = {"a": "href", "link": "href", "img": "src", "script": "src", "source": "src", "iframe": "src"}


class _Page(HTMLParser):
    """The links and the names of elements of one page."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.names |= {name for name in (values.get("id"), values.get("name")) if name}
        if link := values.get(LINKS.get(tag, "")):
            self.links.append(link)


@cache
def parsed(page: Path) -> _Page:
    """Links and names of a page, read once."""
    reader = _Page()
    reader.feed(page.read_text(encoding="utf-8"))
    return reader


def fault(link: str, page: Path, site: Path) -> str | None:
    """What is wrong with a link of a page; None if nothing is."""
    parts = urlsplit(link)
    if parts.scheme in ("http", "https"):
        return None if "." in parts.netloc and " " not in link else "no address"
    if parts.scheme:
        return None if parts.scheme in ("mailto", "data") else f"unknown scheme {parts.scheme}"
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    if not target.is_file():
        return "no such file"
    if site not in target.parents:
        return "leads out of the site"
    if parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in parsed(target).names:
        return "no such element"
    return None


def main(folder: str) -> int:
    """Print the broken links of a site; 1 if there are any."""
    site = Path(folder).resolve()
    pages = sorted(site.rglob("*.html"))
    links = [(page, link) for page in pages for link in dict.fromkeys(parsed(page).links)]
    broken = [(page, link, text) for page, link in links if (text := fault(link, page, site))]
    for page, link, text in broken:
        print(f"{page.relative_to(site)}: {link}: {text}")
    print(f"{len(links) - len(broken)} of {len(links)} links of {len(pages)} pages are good")
    return 1 if broken or not pages else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
