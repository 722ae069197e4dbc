"""Nikon (X-Tek) ``.xtekct``: distances, pixels, axis and white level, with ``.ang`` or ``_ctdata.txt`` beside it.

Signs are those of CIL's `NikonDataReader` (checked there on scans with a rolled and a tilted axis), which agree with
TIGRE's `NikonDataLoader` in the sense of rotation: as the source sees it, column 0 lies at the right and row 0 at the
top, and the stage turns clockwise seen from above as angles grow::

       seen from the source        seen from above        ObjectOffsetX > 0: the axis at higher columns
       column n-1 .... 0           stage turns            ObjectRoll > 0: its top at lower columns
       row 0 at the top            clockwise              ObjectTilt > 0: its top away from the source

Old files have CentreOfRotationTop and CentreOfRotationBottom instead, mm at the detector: the axis' places in the
first and the last row, to higher columns.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.key_file import KeyFile
from grainmotion.io.scanners.nikon_angles import MAIN, angle_table, nikon_angles
from grainmotion.io.scanners.numbered_images import numbered_images, series_of_scan, size_findings
from grainmotion.model.finding import Finding, Level

_NIKON_FACTS = {
    "Sample": (MAIN, "Name", ""), "Voltage": ("Xrays", "XraykV", "kV"), "Current": ("Xrays", "XrayuA", "µA"),
    "Filter": ("CTPro", "Filter_Material", ""), "Filter thickness": ("CTPro", "Filter_ThicknessMM", "mm"),
    "Software": ("CTPro", "Version", ""),
}  # fmt: skip


def read_nikon_scan(path: Path) -> ScannerFile:
    """What an ``.xtekct`` file tells about its scan."""
    keys = KeyFile.read(path)
    if MAIN.lower() not in keys.sections:
        remedy = "give the .xtekct file that the scanner wrote"
        raise InputError(str(path), f"no file of a Nikon scanner: it has no section [{MAIN}]", remedy)
    to_axis, to_detector = keys.distances(MAIN, "SrcToObject", "SrcToDetector")
    pixel = keys.needed(MAIN, "DetectorPixelSizeX")
    height = keys.number(MAIN, "DetectorPixelSizeY")
    if height is not None and not np.isclose(height, pixel, rtol=1e-4):
        fact = f"{height:g} mm, but DetectorPixelSizeX is {pixel:g} mm: pixels that are not square are not supported"
        raise InputError(keys.where(MAIN, "DetectorPixelSizeY"), fact, "give the views of the scan as a CSV")
    numbers, table = range(1, keys.count(MAIN, "Projections") + 1), angle_table(keys)
    there = numbered_images(_folder(keys), f"{keys.text(MAIN, 'Name')}{_separator(keys)}")
    images, findings = series_of_scan(keys.where(MAIN, "Projections"), there, numbers, frozenset(table.angles))
    angles, notes = nikon_angles(keys, list(images) or list(numbers), table)
    offset, tilt = _axis(keys, to_axis / to_detector, pixel)
    detector_offset, found = _detector_offset(keys)
    found += _axis_doubts(keys, offset)
    circle = CircleNumbers(
        beam="cone",
        source_to_axis=to_axis,
        source_to_detector=to_detector,
        pixel_size=pixel,
        detector_offset=detector_offset,
        axis_offset=offset,
        axis_tilt_deg=tilt,
        first_row="top",
        angles_deg=angles,
    )
    shape = keys.number(MAIN, "DetectorPixelsY"), keys.number(MAIN, "DetectorPixelsX")
    sizes = size_findings(keys.where(MAIN, "DetectorPixelsX, DetectorPixelsY"), images, shape)
    white_level = keys.number(MAIN, "WhiteLevel")
    return ScannerFile(
        path,
        "Nikon .xtekct",
        circle,
        radiographs=tuple(str(image) for image in images.values()),
        kind="counts",
        white_level=white_level if white_level is not None and white_level > 0 else None,
        mirrored=True,
        unclear=() if angles is not None else (("angles_deg", f"[{MAIN}] AngularStep is missing"),),
        facts=keys.facts(_NIKON_FACTS),
        findings=(*findings, *notes, *found, *sizes, *keys.end_findings(MAIN)),
    )


def _folder(keys: KeyFile) -> Path:
    """The folder of the images: InputFolderName beside the file if it is there, else that of the file."""
    name = keys.text(MAIN, "InputFolderName")
    if not name:
        return keys.path.parent
    candidates = (keys.path.parent / name.replace("\\", "/"), keys.path.parent / PureWindowsPath(name).name)
    return next((folder for folder in candidates if folder.is_dir()), keys.path.parent)


def _separator(keys: KeyFile) -> str:
    """What stands between name and number of an image; a file that does not tell has "_"."""
    told = "inputseparator" in keys.sections[MAIN.lower()]
    return keys.text(MAIN, "InputSeparator") if told else "_"


def _axis(keys: KeyFile, demagnification: float, pixel: float) -> tuple[float, tuple[float, float]]:
    """Offset of the axis at the sample, mm to the source's right, and its tilt about x and y, degrees."""
    top, bottom = (keys.number(MAIN, f"CentreOfRotation{end}") or 0.0 for end in ("Top", "Bottom"))
    offset, roll = keys.number(MAIN, "ObjectOffsetX"), keys.number(MAIN, "ObjectRoll")
    if offset is None:
        offset = (top + bottom) / 2 * demagnification
    if roll is None:
        height = pixel * (keys.number(MAIN, "DetectorPixelsY") or np.inf)
        roll = -float(np.rad2deg(np.arctan2(top - bottom, height)))
    lean, away = np.deg2rad(roll), np.deg2rad(keys.number(MAIN, "ObjectTilt") or 0.0)
    axis = np.array([np.sin(lean), np.sin(away) * np.cos(lean), np.cos(away) * np.cos(lean)])
    across = float(np.hypot(axis[0], axis[1]))
    scale = np.rad2deg(np.arctan2(across, axis[2])) / across if across > 0 else 0.0
    return -offset, (float(-axis[1] * scale), float(axis[0] * scale))


def _axis_doubts(keys: KeyFile, offset: float) -> tuple[Finding, ...]:
    """A warning where the file leaves the place of the axis to the reconstruction."""
    where, fact, remedy = keys.where(MAIN, "ObjectOffsetX"), "", ""
    if keys.number(MAIN, "ObjectOffsetX") is None and keys.number(MAIN, "CentreOfRotationTop") is None:
        fact = "it is missing, as is CentreOfRotationTop; the axis was taken in the middle of the panel"
        remedy = "see whether the file is complete, or give geometry.axis_offset"
    elif offset == 0 and keys.number(MAIN, "AutomaticCentreOfRotation") == 1:
        where = keys.where(MAIN, "AutomaticCentreOfRotation")
        fact = "1, and the axis has no offset: it was left to the reconstruction; here it is in the middle of the panel"
        remedy = "give geometry.axis_offset if it is known; [calibrate] finds the rest"
    return (Finding(Level.WARNING, "sizes", where, fact, remedy=remedy),) if fact else ()


def _detector_offset(keys: KeyFile) -> tuple[tuple[float, float] | None, tuple[Finding, ...]]:
    """Offset of the panel, to higher columns and upwards, of which public readers differ."""
    x, y = (keys.number(MAIN, f"DetectorOffset{axis}") or 0.0 for axis in "XY")
    if x == 0 and y == 0:
        return None, ()
    fact = f"({x:g}, {y:g}) mm is taken as the panel's shift to higher columns and upwards, which is not documented"
    remedy = "compare a radiograph with its reprojection; geometry.detector_offset = [0, 0] ignores it"
    where = keys.where(MAIN, "DetectorOffsetX, DetectorOffsetY")
    return (-x, -y), (Finding(Level.WARNING, "sizes", where, fact, remedy=remedy),)
