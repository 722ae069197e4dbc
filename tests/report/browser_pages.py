"""Pages opened in Chromium: what their scripts complain about, and what they ask for beyond their own file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urldefrag

from playwright.sync_api import Browser, ConsoleMessage, Page

OWN_SCHEMES = ("data:", "blob:")  # what lies in the page itself


@dataclass
class Complaints:
    """What a page must not do: ``console`` holds errors, ``requests`` addresses of other files."""

    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def listen(self, page: Page, address: str) -> None:
        """Note each message and request of ``page``, which is about to open ``address``."""
        page.on("console", self._message)
        page.on("pageerror", lambda error: self.console.append(f"uncaught: {error}"))
        page.on("request", lambda request: self._request(request.url, address))

    def _message(self, message: ConsoleMessage) -> None:
        if message.type == "error":  # warnings are hints on speed, which depend on the machine's graphics
            self.console.append(message.text)

    def _request(self, url: str, address: str) -> None:
        if urldefrag(url).url != address and not url.startswith(OWN_SCHEMES):
            self.requests.append(url)


@contextmanager
def opened(
    browser: Browser, path: Path, *, width: int = 1400, height: int = 900, dark: bool = False, touch: bool = False
) -> Iterator[tuple[Page, Complaints]]:
    """The page of a file, loaded, in a window of its own, and what it complains about while it is open."""
    scheme = "dark" if dark else "light"
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=touch)
    context.set_default_timeout(20_000)
    try:
        page, complaints, address = context.new_page(), Complaints(), path.resolve().as_uri()
        complaints.listen(page, address)
        page.goto(address, wait_until="load")
        yield page, complaints
    finally:
        context.close()


@contextmanager
def clean(browser: Browser, path: Path, **window: int | bool) -> Iterator[Page]:
    """As `opened`; at its end the page must have reported no error and asked for nothing."""
    with opened(browser, path, **window) as (page, complaints):
        yield page
        assert complaints == Complaints(), f"{complaints}"
