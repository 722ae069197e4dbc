"""Errors of the experiment file in the package's own words: the keys at fault, what is wrong, what to do.

All of them are told at once, in one error: unknown keys first, then what is missing, then values.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from grainmotion._validation import refusal
from grainmotion.errors import ALSO, InputError
from grainmotion.experiment.inherited_keys import ANGLE_KEYS

UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")  # of a table; of the settings of a stage
MISSING_KEY = "missing"
FIRST_ROW_REMEDY = (
    'give first_row = "top" if row 0 of the images shows the top of the sample (the side at which the lid or piston '
    'is; an image viewer shows row 0 at its upper edge, and most cameras write it so), "bottom" if it shows the base '
    "on which the sample stands. `grainmotion inspect` draws the first radiograph with up upwards: if the sample "
    "stands on its head there, give the other one"
)
"""What to do about a missing ``first_row``: it has no default, since a wrong one mirrors every result unnoticed."""
DISTANCE_REMEDY = 'give it in mm, or set beam = "parallel"'
ANGLES_REMEDY = "give a list, a text file, first and step, or first, last and count"
DISTANCES = ("source_to_axis", "source_to_detector")
CIRCLE_OF_REFERENCE = ("reference", "geometry")


@dataclass(frozen=True)
class _Place:
    """Where one of pydantic's errors lies in the file."""

    table: tuple[str, ...]  # keys of the table around it
    key: str
    known: Mapping[str, FieldInfo]  # keys of that table
    error: ErrorDetails

    @property
    def where(self) -> str:
        """As in ``states.one.geometry.angles_deg[1]``."""
        return ".".join((*self.table, self.key))

    @property
    def unknown(self) -> bool:
        """Whether the key is unknown."""
        return self.error["type"] in UNKNOWN_KEY

    @property
    def missing(self) -> bool:
        """Whether the key is missing."""
        return self.error["type"] == MISSING_KEY

    @property
    def near(self) -> str | None:
        """The known key that is most like an unknown one."""
        names = difflib.get_close_matches(self.key, self.known, n=1, cutoff=0.5) if self.unknown else []
        return names[0] if names else None

    @property
    def rank(self) -> int:
        """Order in which errors are told."""
        return 0 if self.unknown else 1 if self.missing and not self.table else 2 if self.missing else 3

    def told(self) -> InputError:
        """The error in the package's own words."""
        if self.unknown:
            remedy = f"did you mean '{self.near}'?" if self.near else f"known keys are {', '.join(self.known)}"
            return InputError(self.where, "unknown key", remedy)
        if self.missing:
            remedy = FIRST_ROW_REMEDY if self.key == "first_row" else "add this key"
            return InputError(self.where, "it is missing", remedy)
        field = self.known.get(self.key.split("[")[0])
        meaning = f": {field.description}" if field is not None and field.description else ""
        return InputError(self.where, refusal(self.error), f"correct the value{meaning}")


def input_error(error: ValidationError, schema: type[BaseModel], data: Mapping[str, object]) -> InputError:
    """All unknown keys, missing keys and invalid values of ``data`` that ``schema`` refused, in one error."""
    places = [_place(e, schema.model_fields, data) for e in error.errors(include_url=False)]
    kept = sorted(_without_repetitions(places), key=lambda place: place.rank)
    return together([place.told() for place in kept] + _missing_beside(kept, data))


def _missing_beside(places: Sequence[_Place], data: Mapping[str, object]) -> list[InputError]:
    """Where the circle of the reference lacks a required key: its distances and angles, if they are missing as well.

    The schema does not require them, as a parallel beam has no distances and a scanner's file may tell all of them.
    """
    of_circle = [place for place in places if place.table == CIRCLE_OF_REFERENCE]
    reference = data.get("reference")
    if not isinstance(reference, Mapping) or not any(place.missing for place in of_circle):
        return []
    circle = reference["geometry"]
    given = {*circle, *(place.near for place in of_circle)}
    parallel = "parallel" in (circle.get("beam"), reference.get("beam"))
    needed = {} if parallel else dict.fromkeys(DISTANCES, DISTANCE_REMEDY)
    missing = {key: remedy for key, remedy in needed.items() if key not in given}
    if not given & set(ANGLE_KEYS):
        missing["angles_deg"] = ANGLES_REMEDY
    where = ".".join(CIRCLE_OF_REFERENCE)
    return [InputError(f"{where}.{key}", "it is missing", remedy) for key, remedy in missing.items()]


def together(errors: Sequence[InputError]) -> InputError:
    """One error that tells several, each on its own line; it is named after the first."""
    first = errors[0]
    others = [text for text in dict.fromkeys(map(str, errors)) if text != str(first)]
    return InputError(first.where, first.fact, ALSO.join([first.remedy, *others])) if others else first


def _without_repetitions(places: Iterable[_Place]) -> list[_Place]:
    """Without errors that follow from another one.

    pydantic reports one error for each choice of a union: the one furthest inside is meant.  A circular state has the
    keys of the reference, with their errors.  A key with a typing error is also missing under its right name.
    """
    kept: dict[str, _Place] = {}
    places = list(places)
    wheres = [place.where for place in places]
    typed = {(place.table, place.near) for place in places if place.unknown}
    top = {place.where for place in places if place.missing and not place.table}
    circle = {(place.key, place.error["type"]) for place in places if place.table == CIRCLE_OF_REFERENCE}
    for place in places:
        inherited = place.table[-1:] == ("geometry",) and place.table[0] != "reference"
        if any(where.startswith((f"{place.where}.", f"{place.where}[")) for where in wheres):
            continue
        if place.missing and (place.table, place.key) in typed:
            continue
        if inherited and (place.key, place.error["type"]) in circle:
            continue
        if inherited and place.missing and "reference" in top:
            continue
        kept.setdefault(place.where, place)
    return list(kept.values())


def _place(error: ErrorDetails, fields: Mapping[str, FieldInfo], data: Mapping[str, object]) -> _Place:
    """Where an error lies, and the known keys of the table around it."""
    keys: list[str] = []
    known: list[Mapping[str, FieldInfo]] = []
    for place in error["loc"]:
        if isinstance(place, int):
            keys[-1] = _state_key(data["states"], place) if keys == ["states"] else f"{keys[-1]}[{place}]"
        elif place in fields:
            keys.append(place)
            known.append(fields)
            fields = _table_fields(fields[place].annotation) or fields
        elif error["type"] in UNKNOWN_KEY and place == error["loc"][-1]:
            keys.append(place)  # any other place is pydantic's name of one choice of a union
            known.append(fields)
    if not keys:
        return _Place((), "the file", fields, error)
    return _Place(tuple(keys[:-1]), keys[-1], known[-1], error)


def _table_fields(annotation: object) -> Mapping[str, FieldInfo]:
    """Fields of the table in a type: itself, a choice of a union or an item of a list; empty without one."""
    own: Mapping[str, FieldInfo] = getattr(annotation, "__pydantic_fields__", {})
    return own or next(filter(None, map(_table_fields, get_args(annotation))), {})


def _state_key(states: object, index: int) -> str:
    """``states.NAME``, or ``states[3]`` (the third) for one without a name."""
    state = states[index] if isinstance(states, list) else None
    name = state.get("name") if isinstance(state, dict) else None
    return f"states.{name}" if isinstance(name, str) else f"states[{index + 1}]"
