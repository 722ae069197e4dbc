"""Tables that say what they hold: units and meanings of their columns, frame and version, in ``DataFrame.attrs``."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

Columns = Mapping[str, tuple[str, str]]
"""Unit and meaning of each column, in order; the unit is "1" for numbers without one, "text" and "yes or no" else."""
SAMPLE_FRAME = (
    "sample frame, right-handed: z up along the rotation axis, origin on it; rotation vectors by the right-hand rule"
)


def vector_columns(name: str, unit: str, meaning: str) -> dict[str, tuple[str, str]]:
    """Three columns, ``name`` followed by x, y and z."""
    return {f"{name}{axis}": (unit, f"{meaning}, {axis}") for axis in "xyz"}


def described(table: pd.DataFrame, columns: Columns, content: str, **more: object) -> pd.DataFrame:
    """The table with attributes ``content``, ``version``, ``frame``, ``units`` and ``meanings``, and ``more``."""
    known = {name: columns[name] for name in table.columns if name in columns}
    table.attrs.update(
        content=content,
        version=version("grainmotion"),
        frame=SAMPLE_FRAME,
        units={name: unit for name, (unit, _) in known.items()},
        meanings={name: meaning for name, (_, meaning) in known.items()},
        **more,
    )
    return table


def frozen(columns: Columns) -> Columns:
    """Columns that nobody changes."""
    return MappingProxyType(dict(columns))
