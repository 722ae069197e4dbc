"""Zeiss Xradia ``.txrm`` and ``.xrm``: what the streams of the file tell about a scan.

No public document defines the signs.  Those of here are the ones on which independent readers agree that were used on
real scans: CIL, xrmreader, txrm2tiff, mbirjax and a reader for a Versa 410 that writes ASTRA's vectors.  Seen with
row 0 at the bottom: the stage turns counter-clockwise from above as ``Angles`` grows, and features have to be moved by
``Alignment/X-Shifts`` columns and ``Y-Shifts`` rows, and by ``CenterShift`` columns, to lie where they belong.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.zeiss_sizes import (
    axis_distance,
    kind_of_beam,
    numbers_per_view,
    panel_pixel,
    stage_findings,
)
from grainmotion.io.txrm import OPEN_BEAM, image_streams, number_of, numbers_of, opened_txrm, texts_of
from grainmotion.model.finding import Finding, Level

if TYPE_CHECKING:
    from olefile import OleFileIO

MAX_CENTER_DIFFERENCE = 0.5
"""Columns by which two numbers of the centre may differ: reconstructions of one scan find it so well."""
NEED_DISTANCES = ("source_to_axis", "source_to_detector", "pixel_size")
"""Keys that follow from the distances."""
MIN_EXPOSURE_CHANGE = 1e-3
"""Exposures that differ by less, relative, are the same."""


def read_zeiss_scan(path: Path) -> ScannerFile:
    """What a ``.txrm`` or ``.xrm`` file tells about its scan."""
    with opened_txrm(path) as ole:
        streams = image_streams(ole, path)
        _check_no_mosaic(ole, path)
        views, findings = streams.numbers - 1, _completeness(ole, path, streams.numbers)
        angles, beam = numbers_per_view(ole, path, "ImageInfo/Angles", views), kind_of_beam(ole)
        near, far = (axis_distance(ole, path, name, views, findings) for name in ("StoRADistance", "DtoRADistance"))
        unclear = [f.fact for f in findings if f.check == "sizes"]
        pixel = panel_pixel(ole, path, beam, None if near is None or far is None else (near + far) / near, findings)
        center = _center_shift(ole, path, findings)
        circle = CircleNumbers(
            beam=beam,
            source_to_axis=None if beam == "parallel" else near,
            source_to_detector=None if beam == "parallel" or near is None or far is None else near + far,
            pixel_size=pixel,
            detector_offset=None if not center or pixel is None else (center * pixel, 0.0),
            first_row="bottom",
            angles_deg=None if angles is None else -angles,
        )
        shifts = _shifts(ole, path, views)
        findings += stage_findings(ole, path, views) if shifts is None else []
        has_flats = ole.exists(f"{OPEN_BEAM}/Image") or ole.exists(f"Multi{OPEN_BEAM}/Image1")
        return ScannerFile(
            path,
            "Zeiss .txrm" if path.suffix.lower() == ".txrm" else "Zeiss .xrm",
            circle,
            radiographs=(str(path.absolute()),),
            flats=(f"{path.absolute()}::{OPEN_BEAM}",) if has_flats else (),
            image_shifts=shifts,
            beam_levels=_levels(ole, views) if has_flats else None,
            unclear=tuple((key, unclear[0]) for key in NEED_DISTANCES if unclear),
            facts=_facts(ole),
            findings=tuple(findings),
        )


def _check_no_mosaic(ole: OleFileIO, path: Path) -> None:
    """Refuse images that are put together of several fields of view, each with a geometry of its own."""
    tiles = [number_of(ole, f"ImageInfo/Mosiac{name}", "<i4") or 0 for name in ("Columns", "Rows")]  # so spelt
    if tiles[0] * tiles[1] > 1 or number_of(ole, "ImageInfo/MosiacMode", "<i4") == 1:
        fact = f"a mosaic of {tiles[0]:.0f} x {tiles[1]:.0f} images, which have no common source and panel"
        raise InputError(str(path), fact, "give a scan of one field of view")


def _completeness(ole: OleFileIO, path: Path, numbers: Index) -> list[Finding]:
    """A finding if fewer images are there than were planned."""
    told = number_of(ole, "ImageInfo/NoOfImages", "<i4") or 0
    if told <= len(numbers):
        return []
    fact = f"{len(numbers)} of {told:.0f} images are in the file: the scan was stopped or not completely copied"
    return [Finding(Level.WARNING, "frames", path.name, fact, remedy="those that are there were used")]


def _center_shift(ole: OleFileIO, path: Path, findings: list[Finding]) -> float | None:
    """Columns by which all images lie too far left, as a reconstruction by Zeiss's software found it."""
    shifts = [s for place in ("ReconSettings", "AutoRecon") if (s := number_of(ole, f"{place}/CenterShift"))]
    if not shifts:
        return None
    fact = f"CenterShift puts the rotation axis {abs(shifts[0]):.4g} columns {'left' if shifts[0] > 0 else 'right'}"
    fact += " of the middle"
    level = Level.NOTE
    if abs(shifts[-1] - shifts[0]) > MAX_CENTER_DIFFERENCE:
        fact += f", but that of AutoRecon is {shifts[-1]:.4g}"
        level = Level.WARNING
    findings.append(Finding(level, "sizes", path.name, fact, remedy="detector_offset overrides it"))
    return shifts[0]


def _shifts(ole: OleFileIO, path: Path, views: Index) -> Float | None:
    """Columns and rows by which features lie further than they should; None if all are in place."""
    shifts = [numbers_per_view(ole, path, f"Alignment/{axis}-Shifts", views) for axis in "XY"]
    both = np.stack([np.zeros(len(views)) if s is None else -s for s in shifts], axis=1)
    return both if both.any() else None


def _levels(ole: OleFileIO, views: Index) -> Float | None:
    """Open beam of each view over that of the flats, by their exposures; None if these are the same."""
    times = numbers_of(ole, "ImageInfo/ExpTimes")
    names = (f"{OPEN_BEAM}/ExpTime", f"{OPEN_BEAM}/ImageInfo/ExpTimes", f"Multi{OPEN_BEAM}/ImageInfo/ExpTimes")
    flat = next((time for name in names if (time := number_of(ole, name))), None)
    if times is None or len(times) <= views.max() or not flat or flat < 0 or not (times[views] > 0).all():
        return None
    levels = times[views] / flat
    return levels if np.abs(levels - 1).max() > MIN_EXPOSURE_CHANGE else None


def _facts(ole: OleFileIO) -> tuple[tuple[str, str], ...]:
    """Voltage, power, objective and so on, as text."""
    numbers = (
        ("Voltage", "ImageInfo/Voltage", "kV"),
        ("Current", "ImageInfo/Current", "uA"),
        ("Power", "AcquisitionSettings/SrcPower", "W"),
        ("Exposure", "ImageInfo/ExpTimes", "s"),
        ("Optical magnification", "ImageInfo/OpticalMagnification", "x"),
    )
    texts = (
        ("Objective", "ImageInfo/ObjectiveName"),
        ("Filter", "AcquisitionSettings/SourceFilterName"),
        ("Date", "ImageInfo/Date"),
    )
    told = [(label, f"{value:.4g} {unit}") for label, name, unit in numbers if (value := number_of(ole, name))]
    return (*told, *((label, found[0]) for label, name in texts if (found := texts_of(ole, name))))
