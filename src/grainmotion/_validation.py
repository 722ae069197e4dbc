"""Validated records: pydantic checks the values, and a wrong one raises the package's own error."""

from __future__ import annotations

import difflib
import functools
from dataclasses import fields
from typing import TypeVar, dataclass_transform

from pydantic import ValidationError
from pydantic.dataclasses import dataclass
from pydantic_core import ErrorDetails

from grainmotion.errors import InputError

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def validated(record: type[T]) -> type[T]:
    """Make a class a frozen dataclass whose values are checked; a wrong one raises `InputError`, naming the field.

    Inside an experiment file pydantic builds the record itself, and `experiment.config` names file and key.
    """
    made: type[T] = dataclass(frozen=True, config={"extra": "forbid"})(record)  # type: ignore[assignment]
    build = made.__init__

    @functools.wraps(build)
    def checked(self: T, *args: object, **values: object) -> None:
        try:
            build(self, *args, **values)
        except ValidationError as error:
            raise _first_error(record, error) from error

    made.__init__ = checked  # type: ignore[assignment]
    return made


def _first_error(record: type, error: ValidationError) -> InputError:
    """The first of pydantic's errors, as the package's own."""
    first = error.errors(include_url=False)[0]
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return cause
    names = [field.name for field in fields(record)]
    place = [names[p] if isinstance(p, int) else p for p in first["loc"][:1]]
    where = ".".join([record.__name__, *map(str, place)])
    if first["type"] == "unexpected_keyword_argument":
        near = difflib.get_close_matches(str(place[0]), names, n=1, cutoff=0.5)
        remedy = f"did you mean '{near[0]}'?" if near else f"known settings are {', '.join(names)}"
        return InputError(where, "unknown setting", remedy)
    return InputError(where, refusal(first), "correct the value")


def refusal(error: ErrorDetails) -> str:
    """The message of one of pydantic's errors, with the value."""
    value = error["input"]
    given = f", got {value!r}" if isinstance(value, str | int | float | bool | list | tuple) else ""
    return error["msg"][0].lower() + error["msg"][1:] + given
