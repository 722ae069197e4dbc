"""What the viewer tells of each grain, and the colours that it has for it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.status import STATUS_COLOURS

if TYPE_CHECKING:
    import pandas as pd

STATUS = "status"
TRANSLATION_VALUES, ROTATION_VALUES = ("u", "ux", "uy", "uz"), ("w", "wx", "wy", "wz")
SUMS: Mapping[str, str] = MappingProxyType({"u": "length of the translation, mm", "w": "angle of the rotation, °",
    "sd_u": "standard deviation of a component of the translation, mm",
    "sd_w": "standard deviation of a component of the rotation, °"})  # fmt: skip
"""Values made of three columns of the table: lengths, and root mean squares of standard deviations."""
UNUSED_RGBA = (0.55, 0.57, 0.6, 1.0)
"""Colour of grains without a value."""
MAP_OF_LENGTHS, MAP_OF_SIGNS = "viridis", "coolwarm"
"""Maps of values of one sign, and of both signs; neither needs a colour-blind eye to tell red from green."""


def grain_table(motions: Motions) -> pd.DataFrame:
    """The table of ``motions.csv`` with `SUMS`; motions that are no results to use are NaN."""
    table = motions.to_table()
    for name in SUMS:
        length = np.linalg.norm(table[[f"{name}{axis}" for axis in "xyz"]].to_numpy(float), axis=1)
        table[name] = length / np.sqrt(3) if name.startswith("sd_") else length
    table.loc[~motions.ok_translation, list(TRANSLATION_VALUES)] = np.nan
    table.loc[~motions.ok_rotation, list(ROTATION_VALUES)] = np.nan
    return table


def check_value(motions: Motions, value: str) -> None:
    """Refuse what is no number of a grain."""
    table = grain_table(motions)
    names = [STATUS, *SUMS, *(name for name in table.select_dtypes("number").columns if name not in SUMS)]
    if value not in names:
        raise InputError("value", f"there is no '{value}' of a grain", f"use one of {', '.join(names)}")


def colour_range(values: Float) -> tuple[str, tuple[float, float]]:
    """Map and limits for finite values: about 0 if they have both signs."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    if low < 0 < high:
        limit = max(-low, high)
        return MAP_OF_SIGNS, (-limit, limit)
    return MAP_OF_LENGTHS, (low, high) if high > low else (low, low + (abs(low) or 1.0))


def grain_colours(motions: Motions, value: str) -> NDArray[np.float64]:
    """Colour of each grain ``(n, 4)``, red, green, blue and opacity from 0 to 1."""
    from matplotlib import colormaps
    from matplotlib.colors import to_rgba

    if value == STATUS:
        return np.array([to_rgba(STATUS_COLOURS[str(status)]) for status in motions.statuses]).reshape(-1, 4)
    values = grain_table(motions)[value].to_numpy(float)
    name, (low, high) = colour_range(values)
    colours = np.array(colormaps[name]((values - low) / (high - low))).reshape(-1, 4)
    colours[~np.isfinite(values)] = UNUSED_RGBA
    return colours
