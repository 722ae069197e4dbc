"""Names in single back-ticks of docstrings: a link where a page describes the name, else code."""

from __future__ import annotations

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.roles import XRefRole


class NameRole(XRefRole):
    """As ``:py:obj:``, but a name that no page describes is code and no warning."""

    def __init__(self) -> None:
        super().__init__(warn_dangling=False, innernodeclass=nodes.literal)

    def process_link(
        self, env: BuildEnvironment, refnode: nodes.Element, has_explicit_title: bool, title: str, target: str
    ) -> tuple[str, str]:
        """Resolve from the documented module and class, as Python's own roles do."""
        refnode["py:module"] = env.ref_context.get("py:module", "grainmotion")
        refnode["py:class"] = env.ref_context.get("py:class")
        refnode["reftype"] = "obj"
        refnode["refdomain"] = "py"
        refnode["refspecific"] = True
        return title, target.removesuffix("()")


def resolve(
    app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, contnode: nodes.Element
) -> nodes.Element | None:
    """A name that nothing describes stays what it is."""
    return contnode if "refname_only" in node else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the role ``name``."""
    app.add_role("name", NameRole())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
