"""NXtomo files as a beamline leaves them, written with h5py alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike

OPEN_BEAM, DARK_LEVEL = 40_000.0, 100.0
FLATS, DARKS = 3, 2


def write_nxtomo(
    path: Path, line_integrals: ArrayLike, angles_deg: ArrayLike, records: Mapping[str, tuple[ArrayLike, str]] = {}
) -> Path:
    """Darks, flats, then projections, rows from the top; ``records`` are (values of the projections, unit) by name.

    The counts of each frame are those of the beam that its ``control/data`` names, 1 unless given.  Flats and darks
    get the mean of a record, except that flats are taken with the sample 50 units out of the beam.
    """
    images = np.asarray(line_integrals)[:, ::-1]
    beam = np.ones(len(images)) if "control/data" not in records else np.asarray(records["control/data"][0], float)
    frames = DARK_LEVEL + OPEN_BEAM * beam[:, None, None] * np.exp(-images)
    flats = np.full((FLATS, *images.shape[1:]), DARK_LEVEL + OPEN_BEAM * beam.mean())
    darks = np.full((DARKS, *images.shape[1:]), DARK_LEVEL)
    with h5py.File(path, "w") as file:
        entry = file.create_group("entry0000")
        entry["instrument/detector/data"] = np.round(np.concatenate([darks, flats, frames])).astype(np.uint16)
        entry["instrument/detector/image_key"] = np.repeat([2, 1, 0], [DARKS, FLATS, len(images)])
        entry["sample/rotation_angle"] = np.r_[np.zeros(DARKS + FLATS), np.asarray(angles_deg, float)]
        entry["sample/rotation_angle"].attrs["units"] = "degree"
        for name, (values, unit) in records.items():
            numbers = np.asarray(values, float)
            if numbers.shape == (len(images),):
                away = 50.0 if "translation" in name else 0.0
                numbers = np.r_[np.full(DARKS, numbers.mean()), np.full(FLATS, numbers.mean() + away), numbers]
            entry[name] = numbers
            if unit:
                entry[name].attrs["units"] = unit
    return path
