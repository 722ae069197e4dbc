"""What the options and arguments of each command take; typer has no public names for it."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Protocol, get_args

NAME = "grainmotion"
_TYPES: dict[str, dict[str, type]] = {}


class Parameter(Protocol):
    """An option or argument of a command, as typer makes it."""

    name: str
    opts: list[str]
    metavar: str | None
    help: str | None


def keep_types(command: str, parameters: Iterable[inspect.Parameter]) -> None:
    """Keep the types of the parameters of a command, by its path, as ``grainmotion export dem``."""
    _TYPES[command] = {parameter.name: _type_of(parameter.annotation) for parameter in parameters}


def parameter_types(command: str) -> Mapping[str, type]:
    """The types of one value of the parameters of a command; empty if there is no such command."""
    return _TYPES.get(command, {})


def words_of(kind: type) -> list[str]:
    """The words that a parameter takes; empty if it takes others."""
    return [str(word.value) for word in kind] if issubclass(kind, Enum) else []


def _type_of(annotation: object) -> type:
    """The type of one value: of ``Annotated[list[Format] | None, …]`` it is ``Format``."""
    while parts := [part for part in get_args(annotation) if part is not type(None)]:
        annotation = parts[0]
    return annotation if isinstance(annotation, type) else str
