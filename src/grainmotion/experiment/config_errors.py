"""Errors of the experiment file in the package's own words: the key at fault, what is wrong, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from grainmotion._validation import refusal
from grainmotion.errors import InputError

UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")  # of a table; of the settings of a stage


def input_error(error: ValidationError, schema: type[BaseModel], data: Mapping[str, object]) -> InputError:
    """An error that names the first unknown key, else the first invalid value, of ``data`` that ``schema`` refused."""
    errors = error.errors(include_url=False)
    first = next((e for e in errors if e["type"] in UNKNOWN_KEY), None)
    if first is None:  # pydantic reports one error for each choice of a union: take the one furthest inside
        table = errors[0]["loc"][:-1]
        first = max((e for e in errors if e["loc"][: len(table)] == table), key=lambda e: len(e["loc"]))
    where, known = _place(first, schema.model_fields, data)
    if first["type"] in UNKNOWN_KEY:
        near = difflib.get_close_matches(str(first["loc"][-1]), known, n=1, cutoff=0.5)
        remedy = f"did you mean '{near[0]}'?" if near else f"known keys are {', '.join(known)}"
        return InputError(where, "unknown key", remedy)
    if first["type"] == "missing":
        return InputError(where, "it is missing", "add this key")
    return InputError(where, refusal(first), "correct the value")


def _place(
    error: ErrorDetails, fields: Mapping[str, FieldInfo], data: Mapping[str, object]
) -> tuple[str, Mapping[str, FieldInfo]]:
    """Where an error lies, as in ``states.one.geometry.angles_deg[1]``, and the known keys of the table around it."""
    keys: list[str] = []
    for place in error["loc"]:
        if isinstance(place, int):
            keys[-1] = _state_key(data["states"], place) if keys == ["states"] else f"{keys[-1]}[{place}]"
        elif place in fields:
            keys.append(place)
            fields = _table_fields(fields[place].annotation) or fields
        elif error["type"] in UNKNOWN_KEY and place == error["loc"][-1]:
            keys.append(place)  # any other place is pydantic's name of one choice of a union
    return ".".join(keys) or "the file", fields


def _table_fields(annotation: object) -> Mapping[str, FieldInfo]:
    """Fields of the table in a type: itself, a choice of a union or an item of a list; empty without one."""
    own: Mapping[str, FieldInfo] = getattr(annotation, "__pydantic_fields__", {})
    return own or next(filter(None, map(_table_fields, get_args(annotation))), {})


def _state_key(states: object, index: int) -> str:
    """``states.NAME``, or ``states[3]`` (the third) for one without a name."""
    state = states[index] if isinstance(states, list) else None
    name = state.get("name") if isinstance(state, dict) else None
    return f"states.{name}" if isinstance(name, str) else f"states[{index + 1}]"
