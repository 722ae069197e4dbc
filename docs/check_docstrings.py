"""Check that everything public has a numpydoc docstring: ``python docs/check_docstrings.py``, part of `make check`.

Public is what `grainmotion` and its `simulate`, `plot` and `viewer` export, and the public methods of exported
classes.  A function with parameters documents each of them; one that returns something says what; one that raises an
error of the package itself says when.  A frozen record documents its fields as attributes.
What the package itself exports has an example, which tests run.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from collections.abc import Iterator
from typing import Any

from numpydoc.docscrape import FunctionDoc
from numpydoc.validate import validate

import grainmotion

CHECKS = {"GL08", "PR01", "PR02", "PR07", "RT01", "RT03", "YD01", "SS03"}
"""No docstring; parameters missing, unknown, without description; returns or yields missing; summary without period."""


def public() -> Iterator[tuple[str, Any]]:
    """Name and object of every public function, class and method."""
    for module in (grainmotion, grainmotion.simulate, grainmotion.plot, grainmotion.viewer):
        for name in sorted(set(module.__all__) - {"simulate", "plot", "viewer"}):
            item = getattr(module, name)
            if not (inspect.isclass(item) or inspect.isfunction(item)):
                continue
            where = f"{item.__module__}.{item.__qualname__}"
            yield where, item
            if inspect.isclass(item):
                for key, member in vars(item).items():
                    if not key.startswith("_") and isinstance(member, property | classmethod | staticmethod) | (
                        inspect.isfunction(member)
                    ):
                        yield f"{where}.{key}", member


def faults(where: str, item: Any) -> list[str]:
    """Messages on what the docstring of a public item lacks."""
    if inspect.isclass(item):
        doc = inspect.getdoc(item) or ""
        if not dataclasses.is_dataclass(item):
            return [] if doc else ["it has no docstring"]
        own = [f.name for f in dataclasses.fields(item) if not f.name.startswith("_")]
        settings = getattr(item, "__pydantic_fields__", {})
        described = [name for name, field in settings.items() if field.description]
        return [f"field {name} is not described" for name in own if name not in described and not _named(name, doc)]
    if isinstance(item, property):
        return [] if item.fget is not None and item.fget.__doc__ else ["it has no docstring"]
    function = item.__func__ if isinstance(item, classmethod | staticmethod) else item
    if not function.__doc__:
        return ["it has no docstring"]
    messages = [text for code, text in validate(where)["errors"] if code in CHECKS]
    simple = len(inspect.signature(function).parameters) - (not isinstance(item, staticmethod) and "." in where) == 0
    if simple:  # a method without parameters may say in its summary what it returns
        messages = [text for text in messages if "Returns" not in text]
    raises = re.findall(r"^\s+raise (\w+Error)\(", inspect.getsource(function), flags=re.MULTILINE)
    if raises and not FunctionDoc(function)["Raises"]:
        messages.append(f"it raises {raises[0]} and has no Raises section")
    return messages


def lacks_example(where: str, item: Any) -> bool:
    """Whether a function or class, not a member of a class, has no section Examples; tests run these sections."""
    is_member = where.removeprefix(f"{item.__module__}.") != item.__name__ if hasattr(item, "__name__") else True
    return not is_member and not re.search(r"^ *Examples\n *--------$", item.__doc__ or "", flags=re.MULTILINE)


def _named(field: str, doc: str) -> bool:
    return re.search(rf"(^|[\s`,]){field}\b", doc, flags=re.MULTILINE) is not None


def main() -> int:
    """Print what is missing; 1 if anything is."""
    lacking, count = {}, 0
    chosen = sys.argv[1:]
    for where, item in dict(public()).items():
        if chosen and not any(where.startswith(f"grainmotion.{name}") for name in chosen):
            continue
        count += 1
        messages = faults(where, item) + ["it has no example"] * lacks_example(where, item)
        if messages:
            lacking[where] = messages
    for where, messages in sorted(lacking.items()):
        print(f"{where}: {'; '.join(messages)}")
    print(f"{count - len(lacking)} of {count} public functions, classes and methods are documented in full")
    return 1 if lacking else 0


if __name__ == "__main__":
    sys.exit(main())
