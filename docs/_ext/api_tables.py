"""The block ``{api}`` of the pages in ``docs/api``: a table of names, then the description of each.

The pages only say which names belong together::

    ```{api} grainmotion
    read_scan
    Scan
    ```
"""

from __future__ import annotations

import enum
import importlib
import inspect
import re

from sphinx.application import Sphinx

BLOCK = re.compile(r"^```\{api\} (?P<module>\S+)\n(?P<names>(?:\w+\n)+)```$", re.MULTILINE)


def directive(module: str, name: str) -> list[str]:
    """The lines of reStructuredText that describe a public name."""
    item = getattr(importlib.import_module(module), name)
    if inspect.ismodule(item):
        return [f".. automodule:: {module}.{name}", "", f".. currentmodule:: {module}"]
    if not inspect.isclass(item):
        return [f".. auto{'function' if callable(item) else 'data'}:: {name}"]
    lines = [f".. autoclass:: {name}"]
    if issubclass(item, enum.Enum):  # its values, not what it inherits from str
        inherited = [key for key in dir(str) if not key.startswith("_")]
        return [*lines, "   :members:", "   :undoc-members:", f"   :exclude-members: {', '.join(inherited)}"]
    return lines if issubclass(item, Exception) else [*lines, "   :members:"]


def expanded(block: re.Match[str]) -> str:
    """The block as a table of summaries and descriptions."""
    module, names = block["module"], block["names"].split()
    lines = [f".. currentmodule:: {module}", "", ".. autosummary::", "", *(f"   {name}" for name in names)]
    for name in names:
        lines += ["", *directive(module, name)]
    return "\n".join(["```{eval-rst}", *lines, "```"])


def expand(app: Sphinx, page: str, source: list[str]) -> None:
    """Expand the blocks of a page before it is parsed."""
    if page.startswith("docs/api/"):
        source[0] = BLOCK.sub(expanded, source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Expand pages as they are read."""
    app.connect("source-read", expand)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
