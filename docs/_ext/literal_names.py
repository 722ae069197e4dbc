"""Names in single back-ticks of docstrings: a link where a page describes the name, else code."""

from __future__ import annotations

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.roles import XRefRole


class NameRole(XRefRole):
    """As ``:py:obj:``, for all text in single back-ticks of docstrings."""

    def process_link(
        self, env: BuildEnvironment, refnode: nodes.Element, has_explicit_title: bool, title: str, target: str
    ) -> tuple[str, str]:
        """Resolve from the documented module and class, as Python's own roles do."""
        refnode["py:module"] = env.ref_context.get("py:module", "grainmotion")
        refnode["py:class"] = env.ref_context.get("py:class")
        refnode["reftype"], refnode["refdomain"] = "obj", "py"
        refnode["is_name"] = True
        if "." in target:  # also of any class: `Motions.fit`
            refnode["refspecific"] = True
        return title, target.removesuffix("()")


def resolve(
    app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, text: nodes.Element
) -> nodes.Element | None:
    """A field links to its class; what no page describes, such as a command or a key, is code and no warning."""
    if not node.get("is_name"):
        return None
    owner, _, _ = node["reftarget"].rpartition(".")
    if owner[:1].isupper():
        domain = env.get_domain("py")
        page = str(node.get("refdoc"))
        found = domain.resolve_xref(env, page, app.builder, "class", owner, node, text)
        if found is not None:
            return found
    return text


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the role ``name``."""
    app.add_role("name", NameRole())
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
