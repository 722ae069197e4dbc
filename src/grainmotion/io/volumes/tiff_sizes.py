"""The voxel size that a TIFF file tells: by ImageJ's or OME's metadata, by tifffile's, or by its resolution tags."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import tifffile

from grainmotion.io.volumes.units import ToldVoxel, told_voxel, unit_in_mm

SCREEN_DPI = (72, 96, 100, 120, 150, 200, 240, 300, 400, 600, 1200)
"""Pixels an inch that programs write for screens and printers: no voxel sizes."""
Told = tuple[ToldVoxel | None, tuple[str, ...]]


def told_size(file: tifffile.TiffFile, text: str) -> Told:
    """The voxel by OME, ImageJ, tifffile's own description or the resolution tags."""
    ome = ome_pixels(text)
    if ome is not None:
        return _ome_voxel(ome)
    resolution = _resolution(file.pages.first)
    told: Mapping[str, object] = file.imagej_metadata or (file.shaped_metadata or ({},))[0]
    unit = told.get("unit")
    if resolution is None:
        return None, ()
    per_x, per_y, dpi_unit = resolution
    x, y = 1 / per_x, 1 / per_y
    if isinstance(unit, str) and unit.strip():
        spacing = told.get("spacing")
        z = float(spacing) if isinstance(spacing, int | float) and spacing > 0 else x
        if unit.lower().startswith("inch") and round(per_x) in SCREEN_DPI:
            return None, (f"its {per_x:.4g} pixels an inch are those of a screen or printer, no voxel size",)
        return told_voxel((x, y, z), unit, "ImageJ properties", one_is_default=True)
    per_inch = per_x * {"inch": 1.0, "cm": 2.54}.get(dpi_unit, 0.0)
    if per_x == 1 or per_inch == 0 or any(abs(per_inch - dpi) < 0.51 for dpi in SCREEN_DPI):
        return None, ()
    return told_voxel((x, y, x), dpi_unit, "XResolution")


def _resolution(page: tifffile.TiffPage) -> tuple[float, float, str] | None:
    """Pixels a unit along x and y, and the unit of the tag: "inch", "cm" or none."""
    values = []
    for name in ("XResolution", "YResolution"):
        tag = page.tags.get(name)
        if tag is None or not isinstance(tag.value, tuple) or 0 in tag.value[:2]:
            return None
        values.append(tag.value[0] / tag.value[1])
    unit = page.tags.get("ResolutionUnit")
    number = 2 if unit is None else int(unit.value)
    return values[0], values[1], {2: "inch", 3: "cm"}.get(number, "")


def ome_pixels(text: str) -> ET.Element | None:
    """The element ``Pixels`` of OME's description; None if it is another one."""
    if "<OME" not in text[:2000]:
        return None
    try:
        return ET.fromstring(text.strip("\x00 \n")).find(".//{*}Pixels")
    except ET.ParseError:
        return None


def _ome_voxel(pixels: ET.Element) -> Told:
    sizes = [pixels.get(f"PhysicalSize{axis}") for axis in "XYZ"]
    units = [pixels.get(f"PhysicalSize{axis}Unit", "µm") for axis, size in zip("XYZ", sizes) if size is not None]
    key = "PhysicalSizeX, Y, Z"
    if sizes[0] is None:
        return None, ()
    try:
        x, y, z = (float(size if size is not None else sizes[0]) for size in sizes)
    except ValueError:
        return None, ()
    if len(set(units)) == 1:
        return told_voxel((x, y, z), units[0], key, one_is_default=True)
    factors = [unit_in_mm(unit) for unit in units]
    if len(factors) != 3 or None in factors:
        return None, (f"{key} tells voxels in units of {', '.join(units)}",)
    return told_voxel([size * (f or 0) for size, f in zip((x, y, z), factors)], "mm", key)


def told_center(
    text: str, imagej: Mapping[str, object], shape: tuple[int, int, int]
) -> tuple[float, float, float] | None:
    """The centre that `tiff_writer.description` wrote, unless the volume was cropped since: ImageJ keeps texts."""
    told = f"{text}\n{imagej.get('Info', '')}"
    if f"shape = {' '.join(map(str, shape))}" not in told:
        return None
    found = re.search(r"center = (\S+) (\S+) (\S+) mm", told) if "grainmotion = " in told else None
    return None if found is None else (float(found[1]), float(found[2]), float(found[3]))
