"""List the public names of the package with their signatures: ``python release/public_api.py`` writes the list.

`release/public_api.txt` is what users' scripts rely on (docs/versioning.md).  A test compares it with the code, so that
a change of the public face is seen in the change that makes it, and is told in the changelog.
"""

from __future__ import annotations

import enum
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import grainmotion as gm

LIST = Path(__file__).with_suffix(".txt")


def lines() -> list[str]:
    """One line a public function, class or member, sorted."""
    return sorted(line for module in public_modules() for line in module_lines(module))


def public_modules() -> list[ModuleType]:
    """The package, and the modules among its public names."""
    inner = [item for name in gm.__all__ if inspect.ismodule(item := getattr(gm, name))]
    return [gm, *inner]


def module_lines(module: ModuleType) -> Iterator[str]:
    """Lines of the public names of one module."""
    for name in module.__all__:
        item = getattr(module, name)
        if not inspect.ismodule(item):
            yield from item_lines(f"{module.__name__}.{name}", item)


def item_lines(where: str, item: Any) -> Iterator[str]:
    """A function with its signature; a class with its constructor's and its public members."""
    if not inspect.isclass(item):
        yield f"{where}{signature(item)}" if callable(item) else f"{where}: {type(item).__name__}"
        return
    if issubclass(item, enum.Enum):
        yield f"{where}: {', '.join(str(member.value) for member in item)}"
        return
    yield f"{where}{signature(item)}"
    if issubclass(item, Exception):
        return
    for key, member in vars(item).items():
        if key.startswith("_"):
            continue
        if isinstance(member, property):
            yield f"{where}.{key}"
        elif isinstance(member, classmethod | staticmethod) or inspect.isfunction(member):
            yield f"{where}.{key}{signature(getattr(item, key))}"


def signature(item: Any) -> str:
    """Parameters and their defaults as text, without types, which may become wider."""
    try:
        found = inspect.signature(item)
    except ValueError:
        return "(...)"
    parameters = [p.replace(annotation=p.empty, default=plain(p.default)) for p in found.parameters.values()]
    return str(found.replace(parameters=parameters, return_annotation=found.empty))


def plain(default: Any) -> object:
    """A default whose text is the same in every process; settings and functions by their names."""
    if default is inspect.Parameter.empty or default is None or isinstance(default, str | int | float | tuple):
        return default
    return Named(default.__name__ if hasattr(default, "__name__") else type(default).__name__)


class Named:
    """A default that is shown by its name."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __repr__(self) -> str:
        return f"<{self.name}>"


def main() -> None:
    """Write the list."""
    LIST.write_text("\n".join(lines()) + "\n", encoding="utf-8")
    print(LIST)


if __name__ == "__main__":
    main()
