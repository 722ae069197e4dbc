"""GE / Waygate phoenix ``.pca``: distances, pixels, axis and angles, with ``.pcj`` (places of the stage) beside it.

Directions are those in which a public reader (SamiAnttalainen/CT_Reconstruction, for CIL) reconstructs: as the source
sees it, column 0 lies at the left and row 0 at the top, and the stage turns clockwise seen from above::

       seen from the source        seen from above        cx, cy: column and row of the central ray, from 0, at the
       column 0 .... n-1           stage turns            middle of a pixel: (DimX - 1)/2, (DimY - 1)/2 if centred
       row 0 at the top            clockwise              CalibValue: pixels from cx to the axis, to higher columns

The images are corrected for offset and gain as they are taken: FreeRay is the count of the open beam in them, by which
datos|x reconstructs, so that the files of [CalibImages] are not used again.  Image n of a scan is taken at n - 1 steps
of RotationSector / NumberImages, as the RS of ``.pcj`` files shows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.key_file import KeyFile
from grainmotion.io.scanners.numbered_images import numbered_images, series_of_scan, size_findings
from grainmotion.io.scanners.phoenix_angles import stage_angles
from grainmotion.model.finding import Finding, Level

MAX_PITCH_RATIO = 1.02
"""Larger differences of pixel size and voxel size times magnification contradict each other."""
MAX_TILT_DEG = 5.0
"""Tilts above it are laminography."""
GEO = "Geometry"
_PHOENIX_FACTS = {
    "Scanner": ("General", "SystemName", ""), "Voltage": ("Xray", "Voltage", "kV"),
    "Current": ("Xray", "Current", "µA"), "Filter": ("Xray", "Filter", ""), "Detector": ("Detector", "Name", ""),
    "Exposure": ("Detector", "TimingVal", "ms"), "Averaged frames": ("Detector", "Avg", ""),
    "Flat": ("CalibImages", "MGainImg", ""), "Dark": ("CalibImages", "OffsetImg", ""),
}  # fmt: skip


def read_phoenix_scan(path: Path) -> ScannerFile:
    """What a ``.pca`` file tells about its scan."""
    keys = KeyFile.read(path)
    if not {GEO.lower(), "ct"} <= set(keys.sections):
        fact = "no file of a phoenix scanner: it lacks the sections [Geometry] and [CT]"
        raise InputError(str(path), fact, "give the .pca file that datos|x wrote beside the images")
    _refuse(keys)
    count = keys.count("CT", "NumberImages")
    numbers, where = range(1, count + 1), keys.where("CT", "NumberImages")
    there = {n: image for n, image in _images(path).items() if n > 0}
    images, series = series_of_scan(where, there, numbers, frozenset({count + 1}))  # one more closes the turn
    shape = keys.number("Image", "DimY"), keys.number("Image", "DimX")
    mirrored = bool(keys.number("Image", "MirrorX"))
    circle, doubts = _circle(keys, shape, mirrored, stage_angles(keys, list(images) or list(numbers), count))
    white = keys.number("Image", "FreeRay")
    return ScannerFile(
        path,
        "phoenix .pca",
        circle,
        radiographs=tuple(str(image) for image in images.values()),
        kind="counts",
        white_level=white if white is not None and white > 0 else None,
        mirrored=mirrored,
        facts=keys.facts(_PHOENIX_FACTS),
        findings=(*series, *size_findings(keys.where("Image", "DimX, DimY"), images, shape), *doubts),
    )


def _refuse(keys: KeyFile) -> None:
    """Scans that are no circle, or whose images are turned."""
    remedy = "name the images and give the views as a CSV"
    if keys.number("Image", "Rotation"):
        fact = f"{keys.text('Image', 'Rotation')}: turned images are not supported"
        raise InputError(keys.where("Image", "Rotation"), fact, f"turn the images back, or {remedy}")
    if keys.number("Trajectory", "Active"):
        raise InputError(keys.where("Trajectory", "Active"), "1: a trajectory that is no circle", remedy)
    if abs(keys.number(GEO, "Tilt") or 0.0) > MAX_TILT_DEG:
        fact = f"{keys.text(GEO, 'Tilt')} degrees: laminography is not supported"
        raise InputError(keys.where(GEO, "Tilt"), fact, remedy)


def _circle(
    keys: KeyFile, shape: tuple[float | None, float | None], mirrored: bool, angles: Float
) -> tuple[CircleNumbers, list[Finding]]:
    """The numbers of the circle, and what of them is doubtful."""
    to_axis, to_detector = keys.distances(GEO, "FOD", "FDD")
    pitch, doubts = _pitch(keys, to_detector / to_axis)
    (rows, columns), (cx, cy) = shape, (keys.number(GEO, f"c{axis}") for axis in "xy")
    to_the_right = -1.0 if mirrored else 1.0  # where higher columns lie, as the source sees it
    across = 0.0 if columns is None or cx is None else ((columns - 1) / 2 - cx) * pitch * to_the_right
    down = 0.0 if rows is None or cy is None else ((rows - 1) / 2 - cy) * pitch
    calibration = keys.number(GEO, "CalibValue") or 0.0
    axis_offset = calibration * pitch * to_axis / to_detector * to_the_right
    if calibration:
        fact = f"{calibration:g} pixels are taken as the axis' shift to higher columns, which is not documented"
        remedy = f"if edges in the volume are double, try geometry.axis_offset = {-axis_offset:.4g}"
        doubts.append(Finding(Level.WARNING, "sizes", keys.where(GEO, "CalibValue"), fact, remedy=remedy))
    turns = (("DetectorRot", "detector_tilts_deg", "[0, {0:g}, 0]"), ("Tilt", "axis_tilt_deg", "[{0:g}, 0]"))
    for key, ours, value in turns:
        if turn := keys.number(GEO, key) or 0.0:
            fact = f"{turn:g} degrees are not used, since their sign is not documented"
            remedy = f"try geometry.{ours} = {value.format(turn)} and {value.format(-turn)}"
            doubts.append(Finding(Level.WARNING, "sizes", keys.where(GEO, key), fact, remedy=remedy))
    for axis, effect in (("X", "column 0 at the right"), ("Y", "row 0 at the bottom")):
        if keys.number("Image", f"Mirror{axis}"):
            fact = f"1 is taken to mean {effect} of the saved images, as the source sees them, which is not documented"
            remedy = 'compare an image with the sample; fixes = ["columns-flipped"] or ["rows-flipped"] undoes it'
            doubts.append(Finding(Level.WARNING, "sizes", keys.where("Image", f"Mirror{axis}"), fact, remedy=remedy))
    circle = CircleNumbers(
        beam="cone",
        source_to_axis=to_axis,
        source_to_detector=to_detector,
        pixel_size=pitch,
        detector_offset=(across, down),
        axis_offset=axis_offset,
        first_row="bottom" if keys.number("Image", "MirrorY") else "top",
        angles_deg=angles,
    )
    return circle, doubts


def _pitch(keys: KeyFile, magnification: float) -> tuple[float, list[Finding]]:
    """Size of a pixel of the saved images, mm: binning makes it larger than the detector's."""
    pixel, voxel = keys.needed("Detector", "PixelsizeX"), keys.number(GEO, "VoxelSizeX")
    height = keys.number("Detector", "PixelsizeY") or pixel
    if not np.isclose(height, pixel, rtol=1e-4):
        fact = f"{height:g} mm, but PixelsizeX is {pixel:g} mm: pixels that are not square are not supported"
        raise InputError(keys.where("Detector", "PixelsizeY"), fact, "give the views of the scan as a CSV")
    if voxel is None or voxel <= 0 or 1 / MAX_PITCH_RATIO < voxel * magnification / pixel < MAX_PITCH_RATIO:
        return pixel, []
    pitch = voxel * magnification
    fact = f"a pixel of {pitch:.5g} mm follows from it, but [Detector] PixelsizeX is {pixel:g} mm; the former was used"
    remedy = "right for binned images; else give geometry.pixel_size"
    return pitch, [Finding(Level.WARNING, "sizes", keys.where(GEO, "VoxelSizeX"), fact, remedy=remedy)]


def _images(path: Path) -> dict[int, Path]:
    """The images beside the file: its name and a number, with or without a mark between them."""
    return max((numbered_images(path.parent, path.stem + mark) for mark in ("", "_", "-")), key=len)
