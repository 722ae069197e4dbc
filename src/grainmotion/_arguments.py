"""Arguments of public functions: an array, file name or other record given in place of a record gets a helpful word."""

from __future__ import annotations

import functools
import inspect
import os
import warnings
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import ParamSpec, TypeVar

import numpy as np

from grainmotion.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")

MAKE: Mapping[str, str] = MappingProxyType({
    "Scan": "give gm.Scan(line_integrals, geometry); of counts gm.line_integrals_from_counts(counts, flats, darks, "
    "geometry), of files gm.read_scan(files, geometry)",
    "Geometry": "give gm.Geometry.cone(angles_deg, ...), gm.Geometry.parallel(angles_deg, ...), or "
    "gm.Geometry(vectors, shape, beam)",
    "Volume": "give gm.Volume(array, voxel_size), or gm.Volume.zeros(shape, voxel_size) for a grid",
    "GrainSet": "give the grains of a reference: gm.Reference.from_scan(scan, grid).grains, or "
    "gm.grains_from_labels(volume, labels)",
    "Motions": "give the motions of gm.track(grains, scan), or gm.read_motions(file)",
    "Surface": "give gm.grain_surface(grain) of a grain of a GrainSet, or gm.Surface(vertices, faces)",
    "Grain": "give one of the grains of a GrainSet: gm.grains_from_labels(volume, labels).grains[0]",
    "Segmentation": "give gm.segment(volume), or gm.grains_from_labels(volume, labels) in place of extract_grains",
    "Reference": "give gm.Reference.from_scan(scan, grid)",
    "Series": "give gm.Series.of(motions), a mapping from the names of states to their motions, in loading order",
    "Plan": "give gm.plan(grains, views)",
    "Comparison": "give gm.compare(measured, truth)",
    "Contacts": "give gm.contacts(grains), or gm.contacts(grains, motions) of a state",
    "Strains": "give gm.strains(motions)",
    "Experiment": 'give gm.read_experiment("experiment.toml")',
    "TrackSettings": "give gm.TrackSettings(key=value)",
    "SegmentSettings": "give gm.SegmentSettings(key=value)",
    "ReconstructSettings": "give gm.ReconstructSettings(key=value)",
    "CalibrateSettings": "give gm.CalibrateSettings(key=value)",
    "HardeningSettings": "give gm.HardeningSettings(key=value)",
    "PlanSettings": "give gm.PlanSettings(key=value)",
    "ReferenceSettings": "give gm.ReferenceSettings(segment=gm.SegmentSettings(key=value))",
    "Sequence[str": "give names of files; of arrays gm.line_integrals_from_counts(counts, flats, darks, geometry), or "
    "gm.Scan(line_integrals, geometry)",
})  # fmt: skip
"""How to make what a parameter wants, by the name in its annotation."""

PLAIN = (np.ndarray, list, tuple, dict, str, os.PathLike, int, float)
"""What users give in place of a record."""


def renamed_arguments(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take arguments under their former names too, ``former="present"``, with a `DeprecationWarning`."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def renamed(*args: P.args, **kwargs: P.kwargs) -> R:
            for former in set(names) & set(kwargs):
                present, where = names[former], function.__qualname__.removesuffix(".__init__")
                if present in kwargs:
                    fact = f"got {present} and its former name {former}"
                    raise InputError(f"{where}({former})", fact, f"give {present} alone")
                warnings.warn(f"{former} of {where} is now {present}", DeprecationWarning, stacklevel=2)
                kwargs[present] = kwargs.pop(former)
            return function(*args, **kwargs)

        return renamed

    return decorate


ARRAY_TYPES = ("NDArray", "Image", "ArrayLike")
ARRAY_OF: Mapping[str, str] = MappingProxyType({
    "Scan": "give its line_integrals", "Volume": "give its array", "Segmentation": "give its labels"
})  # fmt: skip
"""Where the array of a record is."""


def checked_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse plain values and other records where a function's annotations want records, and say how to make these."""
    wanted = {
        name: [part.strip() for part in str(parameter.annotation).split("|")]
        for name, parameter in inspect.signature(function).parameters.items()
    }
    wanted = {name: parts for name, parts in wanted.items() if any(map(_record, parts)) or _is_array(parts)}

    @functools.wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in (*zip(names, args), *kwargs.items()):
            if name in wanted:
                check_argument(f"{function.__name__}({name})", value, wanted[name])
        return function(*args, **kwargs)

    names = tuple(inspect.signature(function).parameters)
    return checked


def _is_array(parts: list[str]) -> bool:
    return any(part.startswith(ARRAY_TYPES) for part in parts)


def _record(part: str) -> str | None:
    """The record that one alternative of an annotation names."""
    return next((name for name in MAKE if part == name or ("[" in name and part.startswith(name))), None)


def check_argument(where: str, value: object, parts: list[str]) -> None:
    """Refuse a plain value or another record where one of the types named in ``parts`` is wanted."""
    given = {c.__name__ for c in type(value).__mro__}
    if given & set(parts) or (value is None and "None" in parts):
        return
    if _is_array(parts):
        held = next((name for name in ARRAY_OF if name in given), None)
        if held is not None:
            raise InputError(where, f"got {held}, wants an array", ARRAY_OF[held])
        return
    sequences = False
    if isinstance(value, list | tuple) and any("[" in part for part in parts):
        sequences = not any(isinstance(item, np.ndarray) for item in value)
    numbers = "float" in parts and isinstance(value, int)
    if sequences or numbers or (isinstance(value, os.PathLike) and "Path" in parts):
        return
    if isinstance(value, PLAIN) or given & set(MAKE):
        record = next(filter(None, map(_record, parts)))
        shown = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else f"{type(value).__name__}"
        raise InputError(where, f"got {shown}, wants {' or '.join(parts)}", MAKE[record])
