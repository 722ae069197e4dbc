"""Distances and sizes of Zeiss's ``.txrm``: converted, held against each other, and left out where they cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Beam, Float, Index
from grainmotion.errors import InputError
from grainmotion.io.txrm import number_of, numbers_of, texts_of
from grainmotion.model.finding import Finding, Level

if TYPE_CHECKING:
    from olefile import OleFileIO

MAX_SIZE_DIFFERENCE = 0.02
"""Pixel sizes of sample and camera that differ by more, relative, contradict each other."""
MAX_DISTANCE_CHANGE = 1e-3
"""Change of a distance within a scan, relative, beyond which the scan is no circle."""
MAX_DISTANCE = 5000.0
"""Distances beyond, mm, are in another unit."""


def numbers_per_view(ole: OleFileIO, path: Path, name: str, views: Index) -> Float | None:
    """Numbers of the images that are there; one number may stand for all."""
    values = numbers_of(ole, name)
    if values is None:
        return None
    if len(values) == 1 < len(views) and name != "ImageInfo/Angles":
        values = np.full(int(views.max()) + 1, values[0])
    if len(values) <= views.max() or not np.isfinite(values[views]).all():
        fact = f"{name} has {len(values)} numbers, not one finite number for each of {views.max() + 1} images"
        raise InputError(str(path), fact, "copy or export the file again, or give images and geometry by hand")
    return np.asarray(values[views])


def kind_of_beam(ole: OleFileIO) -> Beam | None:
    """XrayGeometry: 1 is a cone beam, as of Versa, others a parallel one, as of Ultra."""
    kind = number_of(ole, "ImageInfo/XrayGeometry", "<i4")
    return None if kind is None else "cone" if kind == 1 else "parallel"


def axis_distance(ole: OleFileIO, path: Path, name: str, views: Index, findings: list[Finding]) -> float | None:
    """Distance from source or detector to the rotation axis, mm: its sign is that of the stage's travel."""
    values = numbers_per_view(ole, path, f"ImageInfo/{name}", views)
    if values is None:
        return None
    axes, units = (texts_of(ole, f"PositionInfo/Axis{kind}") for kind in ("Names", "Units"))
    unit = dict(zip(axes, units)).get("Source Z", "mm") if len(axes) == len(units) else "mm"
    values = np.abs(values) * (1e-3 if unit == "um" else 1.0)
    largest = float(values.max())
    if largest == 0:
        return None  # as a parallel beam has it
    fact = ""
    if np.ptp(values) > MAX_DISTANCE_CHANGE * largest:
        fact = f"{name} changes from {values.min():.6g} to {largest:.6g} mm within the scan"
    elif largest > MAX_DISTANCE:
        fact = f"{name} is {largest:.6g}, which is no distance in mm"
    if fact:
        remedy = "it was not used: give source_to_axis and source_to_detector, or the views as a file"
        findings.append(Finding(Level.WARNING, "sizes", path.name, fact, remedy=remedy))
        return None
    return float(np.median(values))


def panel_pixel(
    ole: OleFileIO, path: Path, beam: Beam | None, magnification: float | None, findings: list[Finding]
) -> float | None:
    """Pixels of the image on the panel (or scintillator), mm: PixelSize is at the sample, micrometres."""
    if beam == "parallel":
        magnification = 1.0
    at_sample, optics = (number_of(ole, f"ImageInfo/{name}") for name in ("PixelSize", "OpticalMagnification"))
    camera = number_of(ole, "ImageInfo/CamPixelSize") or number_of(ole, "DetAssemblyInfo/CamPixelSize")
    binning = number_of(ole, "ImageInfo/CameraBinning", "<i4") or 1.0
    of_camera = camera / optics / 1e3 if camera and optics and np.isfinite(optics) and optics > 0 else None
    if not at_sample or at_sample < 0:
        return of_camera * binning if of_camera is not None and beam == "cone" else None
    if magnification is None:
        return None
    size = at_sample / 1e3 * magnification
    if of_camera is not None and beam == "cone":
        ratios = size / (of_camera * np.array([1.0, binning]))
        if np.abs(ratios - 1).min() > MAX_SIZE_DIFFERENCE:
            fact = (
                f"PixelSize makes pixels of {1e3 * size:.4g} um on the scintillator, but CamPixelSize, CameraBinning "
            )
            fact += f"and OpticalMagnification make {1e3 * of_camera * binning:.4g} um; the former was used"
            findings.append(Finding(Level.WARNING, "sizes", path.name, fact, remedy="pixel_size overrides it"))
    return size


def stage_findings(ole: OleFileIO, path: Path, views: Index) -> list[Finding]:
    """A finding if the stage moved by more than a pixel and no shifts of the images tell so."""
    pixel, found = number_of(ole, "ImageInfo/PixelSize"), []
    for axis in "XYZ":
        places = numbers_of(ole, f"ImageInfo/{axis}Position")
        if pixel and places is not None and len(places) > views.max() and np.ptp(places[views]) > pixel:
            found.append(f"{axis} {places[views].min():.5g} to {places[views].max():.5g} um")
    if not found:
        return []
    fact = "the stage moved during the scan, and Alignment/X-Shifts and Y-Shifts do not tell where to"
    remedy = "its positions were not used; give the views as a file if it matters"
    return [Finding(Level.WARNING, "motors", path.name, fact, ", ".join(found), remedy)]
