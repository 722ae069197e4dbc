"""The text of RX Solutions' ``unireconstruction.xml``: distances, number of radiographs, voltage, voxels."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers


def rx_root(path: Path) -> ElementTree.Element:
    """The element ``conebeam`` of the file."""
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(str(path), f"truncated or damaged XML ({error})", "copy or export the file again") from error
    cone = root.find("conebeam") if root.tag == "unireconstruction" else None
    if cone is None:
        fact = f"not a file of RX Solutions: there is no unireconstruction/conebeam, but <{root.tag}>"
        raise InputError(str(path), fact, "give the unireconstruction.xml of a scan")
    return cone


def rx_number(path: Path, root: ElementTree.Element, place: str, name: str) -> float:
    """A positive number of the file."""
    element = root.find(place)
    text = "" if element is None else element.get(name, "")
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = np.nan
    if not 0 < value < np.inf:
        fact = f"conebeam/{place}@{name} is '{text}', not a positive number"
        raise InputError(str(path), fact, "export the file again, or name radiographs and geometry by hand")
    return value


def likely_pixel(root: ElementTree.Element, circle: CircleNumbers) -> tuple[tuple[str, str], ...]:
    """What the voxels say of the pixels: only likely, as the user chooses them."""
    voxel = root.find("volume/voxelSize")
    try:
        size = 0.0 if voxel is None else float(voxel.get("X", "").replace(",", "."))
    except ValueError:
        size = 0.0
    if not size > 0 or not circle.source_to_axis or not circle.source_to_detector:
        return ()
    pixel = size * circle.source_to_detector / circle.source_to_axis
    return (
        ("pixel_size", f"voxels of {size:.5g} mm would be pixels of {pixel:.5g} mm, unless they were chosen otherwise"),
    )


def rx_facts(root: ElementTree.Element) -> tuple[tuple[str, str], ...]:
    """Voltage, current and voxel size, as text."""
    places = (
        ("Voltage", "acquisitioninfo/xray", "voltage", "kV"),
        ("Current", "acquisitioninfo/xray", "current", "uA"),
        ("Voxel size of the reconstruction", "volume/voxelSize", "X", "mm"),
    )
    elements = [(label, root.find(place), name, unit) for label, place, name, unit in places]
    return tuple((label, f"{e.get(name)} {unit}") for label, e, name, unit in elements if e is not None and e.get(name))
