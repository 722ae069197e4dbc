"""Bruker SkyScan ``.log``: distances, image pixel size, optical axis, rotation step, with shifts in a CSV beside it.

Signs are those of TIGRE's `BrukerDataLoader`: as the source sees it, column 0 lies at the right and row 0 at the top,
and the stage turns counter-clockwise seen from above where "Rotation Direction" is CC; "Optical Axis (line)" counts
image rows from the bottom::

       seen from the source        seen from above            rows   top    0   +-----------+
       column n-1 .... 0           CC: the stage turns        rows - line ->    |  central  |  ^
       row 0 at the top            counter-clockwise          bottom n-1   +----| ray       |  | line

"Image Pixel Size (um)" is that of a pixel of the saved images at the axis, binning included.  Pixels are square: the
cone-beam angles that NRecon writes follow from it with the numbers of rows and columns alone.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.scanners.bruker_circle import ACQ, circle_of_log
from grainmotion.io.scanners.bruker_shifts import image_shifts
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.key_file import COPY_FROM_SCANNER, KeyFile, as_number
from grainmotion.io.scanners.numbered_images import numbered_images, series_of_scan, size_findings
from grainmotion.model.finding import Finding, Level

MAX_PIXEL_BITS = 32
"""Bits of a pixel."""
MAX_ROLL_PIXELS = 0.5
"""Displacement of the panel's corner by its rotation that is worth a warning."""
MAX_CROP_SHIFT = 0.02
"""Shift of a cropped part from the middle, over its columns, from which on it is none of rounding."""
_SKYSCAN_FACTS = {
    "Scanner": ("System", "Scanner", ""), "Sample": (ACQ, "Filename Prefix", ""),
    "Voltage": (ACQ, "Source Voltage (kV)", "kV"), "Current": (ACQ, "Source Current (uA)", "µA"),
    "Filter": (ACQ, "Filter", ""), "Exposure": (ACQ, "Exposure (ms)", "ms"),
    "Averaged frames": (ACQ, "Frame Averaging", ""), "Date": (ACQ, "Study Date and Time", ""),
}  # fmt: skip
_REFUSED_SCANS = {
    "Scanning Trajectory": (("ROUND",), "a trajectory that is no circle"),
    "Number Of Horizontal Offset Positions": (("1",), "a scan stitched from several places of the camera"),
    "Camera Offset": (("OFF",), "a scan with the camera beside the axis"),
}


def read_bruker_scan(path: Path) -> ScannerFile:
    """What the ``.log`` of a SkyScan tells about its scan."""
    keys = KeyFile.read(path)
    if not keys.text(ACQ, "Object to Source (mm)") and not keys.text(ACQ, "Rotation Step (deg)"):
        fact = f"no log of a SkyScan: its section [{ACQ}] has no Object to Source (mm)"
        raise InputError(str(path), fact, "give the log that the scanner wrote beside the images, or name the images")
    for key, (usual, fact) in _REFUSED_SCANS.items():
        if keys.text(ACQ, key) and keys.text(ACQ, key).upper() not in usual:
            remedy = "export it as one scan, or name the images and give the views as a CSV"
            raise InputError(keys.where(ACQ, key), f"{keys.text(ACQ, key)}: {fact} is not supported", remedy)
    count = keys.count(ACQ, "Number of Files")
    prefix = keys.text(ACQ, "Filename Prefix")
    there = (numbered_images(path.parent, prefix) if prefix else {}) or numbered_images(path.parent, path.stem)
    last = frozenset({count - 1} if count > 1 else ())  # some scanners count a file that they do not write
    images, series = series_of_scan(keys.where(ACQ, "Number of Files"), there, range(count), last)
    shape = keys.number(ACQ, "Number of Rows"), keys.number(ACQ, "Number of Columns")
    circle, distances = circle_of_log(keys, np.array(list(images) or list(range(count))), shape)
    shifts, shift_notes = image_shifts(keys, list(images))
    white, white_notes = _white_level(keys)
    sizes = size_findings(keys.where(ACQ, "Number of Rows, Number of Columns"), images, shape)
    return ScannerFile(
        path,
        "Bruker SkyScan .log",
        circle,
        radiographs=tuple(str(image) for image in images.values()),
        kind="counts",
        white_level=white,
        mirrored=True,
        image_shifts=shifts,
        facts=keys.facts(_SKYSCAN_FACTS),
        findings=(
            *series,
            *sizes,
            *distances,
            *white_notes,
            *shift_notes,
            *_doubts(keys, shape),
            *keys.end_findings(ACQ),
        ),
    )


def _white_level(keys: KeyFile) -> tuple[float | None, tuple[Finding, ...]]:
    """Count of the open beam in images that are divided by flats."""
    if keys.text(ACQ, "Flat Field Correction").upper() != "ON":
        return None, ()
    told = keys.number(ACQ, "Reference Intensity") or None
    if told is not None and told < 0:
        raise InputError(keys.where(ACQ, "Reference Intensity"), f"{told:g} is no count", "give white_level")
    depth = keys.number(ACQ, "Depth (bits)") or 16.0
    if not 1 <= depth <= MAX_PIXEL_BITS:
        raise InputError(keys.where(ACQ, "Depth (bits)"), f"{depth:g} is no number of bits", COPY_FROM_SCANNER)
    level = told or 2.0**depth - 1
    source = "Reference Intensity" if told else "the highest that the depth allows"
    fact = f"the open beam was taken as {level:g} counts, {source}"
    remedy = "if air shows another count, give it as white_level, or see air"
    return level, (Finding(Level.NOTE, "kind", keys.where(ACQ, "Flat Field Correction"), fact, remedy=remedy),)


def _doubts(keys: KeyFile, shape: tuple[float | None, float | None]) -> list[Finding]:
    """What the log tells but cannot be used with certainty."""
    found = []
    for key, taken in (("Optical Axis (line)", "the middle row"), ("Rotation Direction", "CC")):
        if not keys.text(ACQ, key):
            fact, remedy = f"it is missing; {taken} was taken", "see whether the file is complete"
            found.append(Finding(Level.WARNING, "sizes", keys.where(ACQ, key), fact, remedy=remedy))
    roll, corner = keys.number(ACQ, "Image Rotation") or 0.0, max(n or 0.0 for n in shape) / 2
    if abs(np.deg2rad(roll)) * corner > MAX_ROLL_PIXELS:
        fact = (
            f"{roll:g} degrees are not used, since their sign is not documented: {abs(np.deg2rad(roll)) * corner:.1f}"
        )
        fact += " pixels at the border"
        remedy = f"try geometry.detector_tilts_deg = [0, {roll:g}, 0] and [0, {-roll:g}, 0]; [calibrate] finds the rest"
        found.append(Finding(Level.WARNING, "sizes", keys.where(ACQ, "Image Rotation"), fact, remedy=remedy))
    part, columns = as_number(keys.text(ACQ, "Partial Width").rstrip("% ")), shape[1]
    if part and columns:
        middle = (keys.number(ACQ, "Image crop origin X") or 0.0) + columns / 2 - columns / part * 50
        if abs(middle) > MAX_CROP_SHIFT * columns:
            fact = f"the images seem to be cropped {abs(middle):.0f} columns beside the middle, which is not used"
            remedy = "give geometry.axis_offset, or take the whole width"
            found.append(Finding(Level.WARNING, "sizes", keys.where(ACQ, "Image crop origin X"), fact, remedy=remedy))
    parts = keys.number(ACQ, "Number of connected scans") or 1.0
    if parts > 1:
        fact = f"{parts:g} scans above one another; only that of {keys.text(ACQ, 'Filename Prefix')} is read"
        where = keys.where(ACQ, "Number of connected scans")
        found.append(Finding(Level.WARNING, "field-of-view", where, fact, remedy="each part has its own log"))
    return found
