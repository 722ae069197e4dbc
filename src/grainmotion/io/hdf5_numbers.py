"""Single numbers and texts of HDF5 groups, with the units that their attributes name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import h5py
import numpy as np

from grainmotion._typing import Float

MILLIMETRES: Mapping[str, float] = MappingProxyType({
    "m": 1e3, "meter": 1e3, "metre": 1e3, "meters": 1e3, "metres": 1e3, "cm": 10.0, "mm": 1.0, "millimeter": 1.0,
    "millimetre": 1.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "micron": 1e-3, "microns": 1e-3, "micrometer": 1e-3,
    "micrometre": 1e-3, "nm": 1e-6,
})  # fmt: skip
"""Length of a unit, by its name in lower case."""


@dataclass(frozen=True)
class Length:
    """A length of a file.

    Attributes
    ----------
    mm : float, optional
        None if the file does not hold it, or it cannot be used.
    problem : str
        Why it cannot be used, with its name; empty if it can, or is not there.
    """

    mm: float | None = None
    problem: str = ""


def unit_of(data: h5py.Dataset) -> str:
    """The attribute ``units``: a string, bytes, or an array of one of them; empty without it."""
    unit = np.asarray(data.attrs.get("units", data.attrs.get("unit", ""))).ravel()
    first = unit[0] if len(unit) else ""
    return (first.decode(errors="replace") if isinstance(first, bytes) else str(first)).strip()


def numbers_of(group: h5py.Group, name: str) -> Float | None:
    """The numbers of a dataset, in one row; None without it, or if it holds none."""
    data = group.get(name)
    if not isinstance(data, h5py.Dataset):
        return None
    values = np.asarray(data[()])
    return values.astype(float).ravel() if values.dtype.kind in "biuf" and values.size else None


def number_of(group: h5py.Group, name: str) -> float | None:
    """The one number of a dataset, or that which all of its numbers are; None without it."""
    values = numbers_of(group, name)
    equal = values is not None and np.array_equal(values, np.full_like(values, values[0]), equal_nan=True)
    return float(values[0]) if values is not None and equal else None


def length_of(group: h5py.Group, name: str, *, bare: float | None = None) -> Length:
    """A length that is not zero; ``bare`` is the length in mm of a unit that is not named, None to refuse it."""
    data = group.get(name)
    if not isinstance(data, h5py.Dataset):
        return Length()
    value, unit = number_of(group, name), unit_of(data)
    if value is None:
        return Length(problem=f"{name} holds no single number")
    if not np.isfinite(value) or value == 0:
        return Length(problem=f"{name} is {value:g}")
    scale = MILLIMETRES.get(unit.lower()) if unit else bare
    if scale is None:
        return Length(problem=f"{name} has the unit '{unit}', which is no length" if unit else f"{name} has no unit")
    return Length(value * scale)


def text_of(group: h5py.Group, name: str) -> str:
    """The text of a dataset; empty without it."""
    data = group.get(name)
    if not isinstance(data, h5py.Dataset) or data.size == 0:
        return ""
    value = np.asarray(data[()]).ravel()[0]
    return (value.decode(errors="replace") if isinstance(value, bytes) else str(value)).strip()
