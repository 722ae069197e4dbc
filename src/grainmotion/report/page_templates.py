"""The templates of all pages, read with one set of rules."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined


def page_templates() -> Environment:
    """The templates: all text but `Markup` is escaped, and an undefined name is an error."""
    return Environment(
        loader=PackageLoader("grainmotion.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
