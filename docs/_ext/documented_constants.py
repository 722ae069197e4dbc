"""Constants on their pages of the API: the text below their assignment, wherever the stub says that they come from."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer


def source_of(module: str, name: str) -> str:
    """Full name of the module that defines a name: packages say by their stubs, modules by imports, whose it is."""
    path = Path(str(importlib.import_module(module).__file__))
    stub = path.with_suffix(".pyi")
    for node in ast.parse((stub if stub.exists() else path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and name in {alias.asname or alias.name for alias in node.names}:
            return source_of(f"{module}.{node.module}" if node.level else str(node.module), name)
    return module


def describe_constant(app: Sphinx, kind: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
    """Replace the docstring of the constant's type by the constant's own."""
    if kind == "data":
        module, _, own = name.rpartition(".")
        found = ModuleAnalyzer.for_module(source_of(module, own)).find_attr_docs()
        lines[:] = found.get(("", own), [])


def setup(app: Sphinx) -> dict[str, bool]:
    """Work before numpydoc does, which has the default priority of 500."""
    app.connect("autodoc-process-docstring", describe_constant, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
