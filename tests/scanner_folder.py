"""Helpers: folders as scanners leave them, and how well a geometry reproduces the images of the asymmetric object."""

from pathlib import Path

import numpy as np
import tifffile

from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import Circular, ReferenceTable
from lab_scanner import ball_images

MAX_MISFIT = 0.01
"""Line integrals that differ by less are equal but for the whole numbers of the counts."""
WRONG = 0.1
"""A wrong sign changes the line integrals of some pixel by more."""


def write_images(folder: Path, names: list[str], lines: np.ndarray, white: float) -> None:
    """One 16-bit TIFF a name, of an open beam of ``white`` counts behind line integrals ``(images, rows, columns)``."""
    for name, image in zip(names, lines, strict=True):
        tifffile.imwrite(folder / name, np.round(white * np.exp(-image)).astype(np.uint16))


def scan_of(path: Path, **circle: object) -> ScanInput:
    """The scan of a scanner's file, with keys of ``[reference.geometry]`` over it."""
    geometry = Circular(**{"pixel_size": None, "first_row": None, **circle}) if circle else None
    table = ReferenceTable(radiographs=[str(path)], geometry=geometry)
    return find_scan("reference", table, table, Path())


def misfit(scan: ScanInput) -> float:
    """Largest difference of a scan's line integrals from those that its geometry gives."""
    return float(np.abs(scan.read()[0].line_integrals - ball_images(scan.geometry)).max())


def changed(text: str, **keys: object) -> str:
    """The text of a file of keys with other values; None leaves a key out, and _ in a name stands for a blank."""
    lines = text.split("\r\n")
    for key, value in keys.items():
        at = next(k for k, line in enumerate(lines) if line.split("=")[0].strip().lower() == key.lower())
        lines[at] = "" if value is None else f"{lines[at].split('=')[0]}={value}"
    return "\r\n".join(lines)
