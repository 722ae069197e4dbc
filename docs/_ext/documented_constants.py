"""Constants in the API: their own text on their page, wherever the stub says that they come from, and in signatures
their value where it is a number or a few of them.
"""

from __future__ import annotations

import ast
import importlib
import re
import sys
from numbers import Real
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


CONSTANT_DEFAULT = re.compile(r"(?<==)[A-Z][A-Z0-9_]+\b")


def with_values(signature: str, module: str) -> str:
    """A signature with the values of its constants: ``reach=2.0`` for ``reach=DEFAULT_REACH``."""
    names = vars(sys.modules[module]) if module in sys.modules else {}

    def value(match: re.Match[str]) -> str:
        found = names.get(match[0])
        parts = found if isinstance(found, tuple) and found else (found,)
        return repr(found) if all(isinstance(part, Real) for part in parts) else match[0]

    return CONSTANT_DEFAULT.sub(value, signature)


def show_values(
    app: Sphinx, kind: str, name: str, item: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str, str | None] | None:
    """Put values of constants into the signature of a function, a method or a class."""
    if signature is None:
        return None
    return with_values(signature, getattr(item, "__module__", "")), returned


def setup(app: Sphinx) -> dict[str, bool]:
    """Work before numpydoc does, which has the default priority of 500."""
    app.connect("autodoc-process-docstring", describe_constant, priority=100)
    app.connect("autodoc-process-signature", show_values)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
