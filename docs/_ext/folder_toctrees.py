"""Pages of a folder below its README in the navigation, without a directive in the README itself."""

from __future__ import annotations

from sphinx.application import Sphinx


def add_toctree(app: Sphinx, page: str, source: list[str]) -> None:
    """Append a hidden table of contents to pages named in ``folder_toctrees``."""
    if pattern := app.config.folder_toctrees.get(page):
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n:glob:\n\n{pattern}\n```\n"


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the setting ``folder_toctrees``: the pages to list, relative to the page, as a pattern."""
    app.add_config_value("folder_toctrees", {}, "env")
    app.connect("source-read", add_toctree)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
