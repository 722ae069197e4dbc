"""RX Solutions' ``geom.csv``: where source and panel stand in each view.

Cells are separated by ``;``, two rows are a header.  A row has the name of a radiograph and 12 numbers, mm: source,
centre of the panel, middle of an edge that rows run parallel to, middle of the edge beside the last column.  The axis
is Y through the origin.  So read it two readers written for CIL; they differ in which edge, of row 0 or of the last
row, the third point lies on.  Here it follows from the rest: images are as the source sees them, not mirrored.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.key_file import read_any_text
from grainmotion.model.geometry import Geometry

HEADER_ROWS, NUMBERS = 2, 12
MAX_ASPECT = 1.02
"""Largest ratio of the edges of pixels, which are square."""
_REMEDY = "export it again, or give the views as grainmotion's own CSV"


@dataclass(frozen=True, eq=False)
class ViewTable:
    """The rows of a file.

    Attributes
    ----------
    path : Path
        The file.
    images : tuple of str
        Name of the radiograph of each view, without its folder.
    points : (views, 4, 3) array
        Source, centre of the panel, and middles of two of its edges, X Y Z in mm.
    """

    path: Path
    images: tuple[str, ...]
    points: Float

    def geometry(self, shape: tuple[int, int]) -> Geometry:
        """The views on a panel of ``shape`` pixels; z up along Y, from the height of the first view's source."""
        source, center, third, last = np.moveaxis(self.points, 1, 0)
        edges = np.stack([third - center, last - center], axis=1)
        halves = np.linalg.norm(edges, axis=2)
        pixels = 2 * halves / np.array(shape)
        if not (pixels > 0).all() or max(pixels.max() / pixels.min(), 1) > MAX_ASPECT:
            height, width = 2 * halves[0]
            fact = f"a panel of {height:.5g} x {width:.5g} mm and images of {shape} pixels make pixels of "
            fact += f"{pixels[0, 0]:.4g} x {pixels[0, 1]:.4g} mm, which are not square"
            raise InputError(str(self.path), fact, "give the images of that scan, neither binned nor cropped")
        if (np.abs(edges[:, 0, 1]) < np.abs(edges[:, 1, 1])).any():
            fact = "its third point lies beside the panel's centre, not above or below it along Y"
            raise InputError(str(self.path), fact, "give the views as grainmotion's own CSV")
        u = edges[:, 1] / (shape[1] / 2)
        v = edges[:, 0] / (shape[0] / 2)
        away = np.einsum("vi,vi->v", np.cross(u, v), center - source) > 0  # right x down leads along the beam
        v = np.where(away[:, None], v, -v)
        start = np.array([0.0, source[0, 1], 0.0])
        blocks = [source - start, center - start, u, v]
        up = -1.0 if v[:, 1].mean() > 0 else 1.0  # rows run downwards
        frame = np.array([[0, 0, 1.0], [up, 0, 0], [0, up, 0]])  # x, y, z are Z, X, Y, or Z, -X, -Y
        return Geometry(np.concatenate([block @ frame.T for block in blocks], axis=1), shape, "cone")


def is_rx_table(path: Path) -> bool:
    """Whether a file is such a table, by its content."""
    try:
        lines = read_any_text(path).split("\n", HEADER_ROWS + 1)
    except InputError:
        return False
    return len(lines) > HEADER_ROWS and lines[HEADER_ROWS].count(";") >= NUMBERS and "sx" not in lines[0].lower()


def read_rx_table(path: Path) -> ViewTable:
    """The rows of a ``geom.csv``."""
    images, rows = [], []
    for k, line in enumerate(read_any_text(path).split("\n"), start=1):
        cells = [cell.strip().strip('"') for cell in line.split(";")]
        if k <= HEADER_ROWS or not any(cells):
            continue
        try:
            numbers = [float(cell.replace(",", ".")) for cell in cells[1 : NUMBERS + 1]]
        except ValueError:
            numbers = []
        if len(numbers) < NUMBERS or not np.isfinite(numbers).all():
            fact = f"line {k} is '{line[:60]}', not the name of a radiograph and {NUMBERS} numbers, separated by ;"
            raise InputError(str(path), fact, _REMEDY)
        images.append(PureWindowsPath(cells[0]).name)
        rows.append(numbers)
    if not rows:
        raise InputError(str(path), "it holds no view below its two header rows", _REMEDY)
    return ViewTable(path, tuple(images), np.array(rows).reshape(-1, 4, 3))
