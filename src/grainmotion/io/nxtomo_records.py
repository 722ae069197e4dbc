"""Numbers of each frame that an NXtomo file holds beside its frames: beam monitor, translations of the stage."""

from __future__ import annotations

from dataclasses import dataclass

import h5py
import numpy as np

from grainmotion._typing import Float
from grainmotion.io.hdf5_numbers import MILLIMETRES, unit_of

MONITOR = "control/data"
TRANSLATIONS = ("sample/x_translation", "sample/y_translation", "sample/z_translation")


@dataclass(frozen=True, eq=False)
class Record:
    """Numbers of one dataset, one for each frame.

    Attributes
    ----------
    name : str
        Its path in the entry.
    values : (frames,) array
        As in the file; those of a scalar are repeated.  NaN in all frames if their number does not match.
    unit : str
        As in the file; empty if it names none.
    problem : str
        Why the values cannot be used; empty if they can.
    """

    name: str
    values: Float
    unit: str = ""
    problem: str = ""

    @property
    def scale(self) -> float | None:
        """Millimetres of its unit; 1 if the file names none, None if the unit is no length."""
        return MILLIMETRES.get(self.unit.strip().lower()) if self.unit.strip() else 1.0


def read_records(entry: h5py.Group, frames: int) -> tuple[Record, ...]:
    """The records that an entry holds, of those known here."""
    names = (MONITOR, *TRANSLATIONS)
    return tuple(_record(entry[name], name, frames) for name in names if isinstance(entry.get(name), h5py.Dataset))


def _record(data: h5py.Dataset, name: str, frames: int) -> Record:
    unit = unit_of(data)
    try:
        values = np.asarray(data[()], dtype=float).ravel()
    except (TypeError, ValueError):
        return Record(name, np.full(frames, np.nan), unit, "it holds no numbers")
    if len(values) == 1:
        return Record(name, np.full(frames, values[0]), unit)
    if len(values) != frames:
        return Record(name, np.full(frames, np.nan), unit, f"it holds {len(values)} numbers for {frames} frames")
    return Record(name, values, unit)
