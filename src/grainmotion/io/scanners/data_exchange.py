"""Data Exchange (HDF5, APS and others): frames, flats and darks of a parallel-beam scan, angles, size of a pixel.

Facts: the Data Exchange definition, X-ray tomography (data-exchange/dxfile, doc/source/xraytomo.rst).  Units that are
not named are SI there, but beamlines write angles in degrees without naming them, too.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.angles import in_degrees
from grainmotion.io.hdf5 import opened
from grainmotion.io.hdf5_numbers import Length, length_of, number_of, numbers_of, text_of, unit_of
from grainmotion.io.hdf5_sources import check_link
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.model.finding import Finding, Level

MIN_SPAN_OF_DEGREES = 6.4
"""Angles without a unit that span so much are degrees; those that span less may be radians."""
MAX_PIXEL = 1.0
"""mm; a larger pixel without a unit is no number of metres."""
INSTRUMENT = "measurement/instrument"
ENERGY = f"{INSTRUMENT}/monochromator/energy"
OBJECTIVES = (f"{INSTRUMENT}/detection_system/objective", f"{INSTRUMENT}/detector/objective")


def is_data_exchange(path: Path) -> bool:
    """Whether an HDF5 file holds groups of Data Exchange."""
    with opened(path) as file:
        return bool(_groups(file))


def read_data_exchange(path: Path) -> ScannerFile:
    """What a Data Exchange file tells about its scan."""
    with opened(path) as file:
        groups = _groups(file)
        name = "exchange" if "exchange" in groups else groups[0]
        if len(groups) > 1 and "exchange" not in groups:
            remedy = f"name the frames of one: {_one_scan(path, name)}"
            raise InputError(str(path), f"it holds several scans: {', '.join(groups)}", remedy)
        group = file[name]
        count = _frames(group, path)
        angles, why_angles = _angles_deg(group, count, path)
        pixel = _pixel(file)
        findings = _shifts(group, path)
        names = {"Sample": "measurement/sample/name", "Beamline": f"{INSTRUMENT}/name", "Title": f"{name}/title"}
        facts = [(label, text_of(file, key)) for label, key in names.items()]
        energy = number_of(file, ENERGY)
        facts += [] if energy is None else [("Energy", f"{energy:g} {unit_of(file[ENERGY])}")]
        stacks = {key: _beam_images(group, key, path) for key in ("data_white", "data_dark")}
    others = [other for other in groups if other != name]
    if others:
        fact = f"the frames of /{name} were read; it also holds {', '.join(others)}"
        remedy = f"if another is meant, set {_one_scan(path, others[0])}"
        findings.append(Finding(Level.NOTE, "kind", str(path), fact, remedy=remedy))
    return ScannerFile(
        path,
        "Data Exchange",
        CircleNumbers(beam="parallel", pixel_size=pixel.mm, angles_deg=angles),
        radiographs=(f"{path}::/{name}/data",),
        flats=stacks["data_white"],
        darks=stacks["data_dark"],
        unclear=tuple((k, why) for k, why in (("angles_deg", why_angles), ("pixel_size", pixel.problem)) if why),
        facts=tuple((label, text) for label, text in facts if text),
        findings=tuple(findings),
    )


def _beam_images(group: h5py.Group, key: str, path: Path) -> tuple[str, ...]:
    """Flats or darks: those of the definition, and those before and after the scan as some beamlines write them."""
    return tuple(f"{path}::{group.name}/{name}" for name in (key, f"{key}_pre", f"{key}_post") if name in group)


def _one_scan(path: Path, group: str) -> str:
    """The keys of one of several scans in a file: its angles and flats do not come with its frames."""
    own = f"{path.name}::/{group}"
    angles = f'geometry = {{ angles_deg = "{own}/theta" }}'
    return f'radiographs = "{own}/data", flats = "{own}/data_white", darks = "{own}/data_dark", {angles}'


def _groups(file: h5py.File) -> list[str]:
    """Names of the groups with frames."""
    for name in file:
        if name == "exchange" or name.startswith("exchange_"):
            check_link(file, f"{name}/data")
    return [n for n in file if (n == "exchange" or n.startswith("exchange_")) and isinstance(file.get(n), h5py.Group)]


def _frames(group: h5py.Group, path: Path) -> int:
    """Number of frames, whose first axis has to be the angles."""
    data = group.get("data")
    where = f"{path}::{group.name}/data"
    if not isinstance(data, h5py.Dataset) or data.ndim != 3:
        fact = "it is missing" if data is None else f"its shape {getattr(data, 'shape', '')} is no stack of frames"
        raise InputError(where, fact, "give a file with the frames of a scan: theta, y, x")
    axes = data.attrs.get("axes", "")
    order = (axes.decode() if isinstance(axes, bytes) else str(axes)).replace(" ", "").lower()
    if order and not order.startswith("theta"):
        raise InputError(where, f"its axes are {order}: sinograms", "write the frames in the order theta:y:x")
    return int(data.shape[0])


def _angles_deg(group: h5py.Group, count: int, path: Path) -> tuple[Float | None, str]:
    """Angles of the frames, or why the file does not tell them."""
    theta, where = numbers_of(group, "theta"), f"{path}::{group.name}/theta"
    if theta is None:
        return None, "it holds no theta"
    if len(theta) != count:
        raise InputError(where, f"{len(theta)} angles for {count} frames", "give angles_deg, one a frame")
    if not np.isfinite(theta).all():
        return None, "theta holds numbers that are not finite"
    unit = unit_of(group["theta"])
    if not unit and np.ptp(theta) < MIN_SPAN_OF_DEGREES:
        return None, f"theta spans {np.ptp(theta):.4g} and names no unit"
    return in_degrees(theta, unit, where), ""


def _pixel(file: h5py.File) -> Length:
    """Edge of a pixel at the sample: told, or that of the camera over the magnification of its objective."""
    for name in (f"{INSTRUMENT}/detector/actual_pixel_size_x", *(f"{o}/resolution" for o in OBJECTIVES)):
        if name in file and (size := _size(file, name)).mm is not None:
            return size
    size = _size(file, f"{INSTRUMENT}/detector/pixel_size_x")
    factors = [number_of(file, f"{o}/magnification") for o in OBJECTIVES]
    factor = next((f for f in factors if f is not None and f > 0), 1.0)
    return size if size.mm is None else Length(size.mm / factor)


def _size(file: h5py.File, name: str) -> Length:
    size = length_of(file, name, bare=1e3)
    if size.mm is not None and not 0 < size.mm <= MAX_PIXEL:
        why = "" if unit_of(file[name]) else ", if it is in metres, as it names no unit"
        return Length(problem=f"{name.rsplit('/', 1)[-1]} is {size.mm:.4g} mm{why}")
    return size


def _shifts(group: h5py.Group, path: Path) -> list[Finding]:
    """A warning about shifts of the frames, whose sense the definition leaves open."""
    used = [n for n in ("data_shift_x", "data_shift_y") if (v := numbers_of(group, n)) is not None and v.any()]
    if not used:
        return []
    fact = f"{' and '.join(used)} were not used, as the format does not tell their sense"
    remedy = "give the views as a file, or undo the shifts in the images"
    return [Finding(Level.WARNING, "motors", str(path), fact, remedy=remedy)]
