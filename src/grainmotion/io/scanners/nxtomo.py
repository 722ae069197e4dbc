"""NXtomo (NeXus, HDF5): angles of the projections, flats and darks of one file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion.io.hdf5 import read_nxtomo
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile


def read_nxtomo_scan(path: Path) -> ScannerFile:
    """What an NXtomo file tells about its scan."""
    file = read_nxtomo(path)
    angles = file.projection_angles_deg
    circle = CircleNumbers(angles_deg=angles if len(angles) and np.isfinite(angles).all() else None)
    return ScannerFile(path, "NXtomo", circle, radiographs=(str(path),))
