"""Arguments of public functions: what is given in place of a record, number, text or axes gets a helpful word."""

from __future__ import annotations

import functools
import inspect
import numbers
import operator
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
    "StateFit": "give the motions of gm.track(grains, scan), or their fit: motions.fit",
    "CheckSettings": "give gm.CheckSettings(key=value)",
    "ScanSettings": "give gm.ScanSettings(key=value)",
    "Sample": "give the sample of a case: gm.simulate.small().sample, or gm.simulate.Sample(particles)",
    "Particle": "give gm.simulate.Particle(shape, attenuation)",
    "Generator": "give np.random.default_rng(seed)",
    "ReportData": "give grainmotion.report.ReportData(...); a run writes report.html by itself",
    "Ellipsoid": "give gm.simulate.Ellipsoid(center, semi_axes, axes)",
    "Mesh": "give a shape: gm.simulate.stone(0), gm.simulate.sphere(diameter), or gm.simulate.polyhedron(points)",
    "Physics": "give gm.simulate.Physics(key=value)",
    "PackingSettings": "give gm.simulate.PackingSettings(radius)",
    "Mapping[str, Motions": 'give a dictionary from names of states to their motions: {"step-01": motions}',
    "Mapping[str, float": 'give a dictionary from names of states to seconds: {"step-01": 60.0}',
    "Sequence[Particle": "give a list of gm.simulate.Particle(shape, attenuation)",
    "Sequence[str": "give names of files; of arrays gm.line_integrals_from_counts(counts, flats, darks, geometry), or "
    "gm.Scan(line_integrals, geometry)",
})  # fmt: skip
"""How to make what a parameter wants, by the name in its annotation."""


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


ARRAY_TYPES = ("NDArray", "Image", "ArrayLike", "Float")
ARRAY_OF: Mapping[str, str] = MappingProxyType({
    "Scan": "give its line_integrals", "Volume": "give its array", "Segmentation": "give its labels"
})  # fmt: skip
"""Where the array of a record is."""
UNIONS: Mapping[str, tuple[str, ...]] = MappingProxyType({"Shape": ("Mesh", "Ellipsoid")})
"""Names of annotations that stand for several types."""
NUMBER_SEQUENCES = ("Sequence[float", "Sequence[int")
LISTS = (*NUMBER_SEQUENCES, "tuple[")
SCALARS: Mapping[str, str] = MappingProxyType({
    "Path": "give the name of a file or folder", "float": "give a number", "int": "give a whole number",
    "bool": "give True or False", "str": "give a text",
})  # fmt: skip
"""What to give where one value is wanted."""


def checked_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse values that a function's annotations do not allow, and say what to give.

    Records, arrays, numbers, texts, and the axes of figures are looked at; texts that name one of several choices, and
    values that depend on each other, are the function's own business.
    """
    parameters = inspect.signature(function).parameters
    wanted = {name: _alternatives(str(p.annotation)) for name, p in parameters.items()}
    wanted = {name: parts for name, parts in wanted.items() if _checkable(parts)}
    names = tuple(parameters)

    @functools.wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in (*zip(names, args), *kwargs.items()):
            if name in wanted:
                check_argument(f"{function.__name__}({name})", value, wanted[name])
        return function(*args, **kwargs)

    return checked


def check_argument(where: str, value: object, parts: list[str]) -> None:
    """Refuse a value of another type than those named in ``parts``, the alternatives of an annotation."""
    given = {c.__name__ for c in type(value).__mro__}
    if given & set(parts) - set(SCALARS) or (value is None and "None" in parts):
        return
    if "Axes" in parts or "Axes3D" in parts:
        _check_axes(where, value, given)
    elif _is_array(parts):
        held = next((name for name in ARRAY_OF if name in given), None)
        if held is not None:
            raise InputError(where, f"got {held}, wants an array", ARRAY_OF[held])
        if not (_is_scalar(value, parts) or _is_array_like(value)):
            raise InputError(where, f"got {_shown(value)}, wants an array", "give an array of numbers")
    elif "Progress" in parts:
        if not callable(value):
            remedy = "give a function of (message, done, total), or leave it out"
            raise InputError(where, f"got {_shown(value)}, wants a function", remedy)
    elif not (_is_scalar(value, parts) or _is_sequence(value, parts)):
        raise _refusal(where, value, parts)


def _alternatives(annotation: str) -> list[str]:
    """The types that an annotation names, without their modules."""
    parts = [part.strip().removeprefix("np.random.") for part in annotation.split("|")]
    return [name for part in parts for name in UNIONS.get(part, (part,))]


def _checkable(parts: list[str]) -> bool:
    known = (*SCALARS, "Axes", "Axes3D", "Progress", "None")
    return any(map(_record, parts)) or _is_array(parts) or all(p in known or p.startswith(LISTS) for p in parts)


def _is_array_like(value: object) -> bool:
    """Whether a value is an array, or makes one of numbers; arrays of files are not read for that."""
    if hasattr(value, "shape") or hasattr(value, "__array__"):
        return True
    try:
        return np.asarray(value).dtype.kind in "biufc"
    except ValueError:  # rows of different lengths
        return False


def _of_numbers(part: str) -> bool:
    return part.startswith(NUMBER_SEQUENCES)


def _is_array(parts: list[str]) -> bool:
    return any(part.startswith(ARRAY_TYPES) for part in parts)


def _record(part: str) -> str | None:
    """The record that one alternative of an annotation names."""
    return next((name for name in MAKE if part == name or ("[" in name and part.startswith(name))), None)


def _is_scalar(value: object, parts: list[str]) -> bool:
    """Whether a value is one of the plain types among ``parts``; whole numbers of NumPy are integers, too."""
    if "Path" in parts and isinstance(value, str | os.PathLike):
        return True
    if isinstance(value, str):
        return "str" in parts
    if isinstance(value, bool | np.bool_):
        return "bool" in parts
    if "float" in parts and (isinstance(value, numbers.Real) or (isinstance(value, np.ndarray) and value.ndim == 0)):
        return True
    if "int" in parts:
        try:
            operator.index(value)  # type: ignore[arg-type]  # that is what is tried
        except TypeError:
            return False
        return True
    return False


def _is_sequence(value: object, parts: list[str]) -> bool:
    """Whether a list of records or files is given where ``parts`` want one, or numbers where they want numbers."""
    if any(map(_of_numbers, parts)) and isinstance(value, list | tuple | range | set | np.ndarray):
        array = np.asarray(list(value))
        return array.ndim == 1 and (array.size == 0 or array.dtype.kind in "iuf")
    if any(part.startswith("tuple[") for part in parts) and isinstance(value, list | tuple | np.ndarray):
        item = "int" if any(part.startswith("tuple[int") for part in parts) else "float"
        return np.ndim(value) == 1 and all(_is_scalar(number, [item]) for number in value)
    if isinstance(value, Mapping):
        return any(part.startswith("Mapping[") for part in parts)
    if isinstance(value, list | tuple) and any(part.startswith("Sequence[") for part in parts):
        return not any(isinstance(item, np.ndarray) for item in value)
    return False


def _check_axes(where: str, value: object, given: set[str]) -> None:
    if "Axes" not in given:
        remedy = "give one of the axes that plt.subplots() makes, such as axes[0] of several; or leave ax out"
        raise InputError(where, f"got {_shown(value)}, wants Axes", remedy)


def _refusal(where: str, value: object, parts: list[str]) -> InputError:
    record = next(filter(None, map(_record, parts)), None)
    if record is not None:
        return InputError(where, f"got {_shown(value)}, wants {' or '.join(parts)}", MAKE[record])
    scalar = next((name for name in SCALARS if name in parts), None)
    remedy = "give a list of numbers" if scalar is None else SCALARS[scalar]
    return InputError(where, f"got {_shown(value)}, wants {' or '.join(parts)}", remedy)


def _shown(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, str | numbers.Number):
        return f"{type(value).__name__} {value!r}"
    return type(value).__name__
