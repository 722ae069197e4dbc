"""Files that hold whole positions of source and panel in each view, and what they need to know of the panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from grainmotion._typing import Beam
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.scanners.rx_table import is_rx_table, read_rx_table
from grainmotion.model.geometry import Geometry


@dataclass(frozen=True)
class Panel:
    """What images and experiment file tell of a panel.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the images.
    pixel_size : float, optional
        mm; only formats without the pixels' steps need it.
    first_row : {"top", "bottom"}, optional
        Where row 0 of the images lies; only formats that do not tell need it.
    beam : {"cone", "parallel"}
        Kind of beam, of formats that do not tell.
    """

    shape: tuple[int, int]
    pixel_size: float | None = None
    first_row: Literal["top", "bottom"] | None = None
    beam: Beam = "cone"


def _read_csv(path: Path, panel: Panel) -> Geometry:
    if is_rx_table(path):
        return read_rx_table(path).geometry(panel.shape)
    return read_geometry(path, panel.shape, panel.beam)


ViewReader = Callable[[Path, Panel], Geometry]
VIEW_READERS: Mapping[str, ViewReader] = MappingProxyType({".csv": _read_csv, ".txt": _read_csv})
"""Reader of the files with a suffix, in lower case."""
