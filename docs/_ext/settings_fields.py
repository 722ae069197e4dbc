"""Settings and records on their pages of the API: the fields that pydantic describes become numpydoc's Attributes."""

from __future__ import annotations

import inspect
from typing import Any

from sphinx.application import Sphinx


def describe_fields(app: Sphinx, kind: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    """Append a section Attributes with the name, default and description of each field of settings."""
    fields = getattr(item, "__pydantic_fields__", None)
    if kind != "class" or not fields or "Attributes" in lines:
        return
    section = ["", "Attributes", "----------"]
    for field, described in fields.items():
        default = (
            "" if described.is_required() else f" : default ``{described.get_default(call_default_factory=True)!r}``"
        )
        section += [f"{field}{default}", f"    {_sentence(described.description or '')}"]
    at = next((k for k, line in enumerate(lines) if line in ("Raises", "Examples", "See Also", "Notes")), len(lines))
    lines[at:at] = [*section, ""]


def _sentence(text: str) -> str:
    text = inspect.cleandoc(text)
    return text[:1].upper() + text[1:] + "."


def setup(app: Sphinx) -> dict[str, bool]:
    """Work before numpydoc does, which has the default priority of 500."""
    app.connect("autodoc-process-docstring", describe_fields, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
