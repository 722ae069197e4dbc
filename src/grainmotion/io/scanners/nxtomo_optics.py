"""Beam, distances, size of a pixel and place of the axis of an NXtomo file.

Since version 1.5 of the ESRF's files ``sample/x_pixel_size`` is a pixel at the sample and ``detector/x_pixel_size`` one
of the panel; before, the latter was one at the sample.
"""

from __future__ import annotations

import h5py
import numpy as np

from grainmotion._typing import Beam
from grainmotion.io.hdf5_numbers import Length, length_of, number_of, text_of
from grainmotion.io.scanners.description import CircleNumbers
from grainmotion.io.scanners.nxtomo_detector import version_of
from grainmotion.model.finding import Finding, Level

DETECTOR = "instrument/detector"
AXIS_NAMES = ("x_rotation_axis_pixel_position", "estimated_cor_from_motor", "estimated_cor_frm_motor")
NEAR_THE_MIDDLE = 0.25
"""A column within this share of the width from the middle counts from the left; a smaller number from the middle."""
MAX_SPREAD_OF_PARALLEL_RAYS = 0.1
"""Rays of a source so far away that they diverge by less than this over the field, pixels, are parallel."""
SAMPLE_PIXEL_SINCE = 1.5
"""Version of the ESRF's files from which ``detector/x_pixel_size`` is one of the panel."""


def optics_of(entry: h5py.Group, shape: tuple[int, int]) -> tuple[CircleNumbers, list[tuple[str, str]], list[Finding]]:
    """Beam, distances and pixel size; keys that the file does not tell clearly; findings."""
    source, panel = length_of(entry, "instrument/source/distance"), length_of(entry, f"{DETECTOR}/distance")
    on_panel, at_sample = _pixel(entry, DETECTOR), _pixel(entry, "sample")
    optical = number_of(entry, f"{DETECTOR}/magnification")
    version = version_of(entry)
    if at_sample.mm is None and (
        f"{DETECTOR}/real_x_pixel_size" in entry or (version is not None and version < SAMPLE_PIXEL_SINCE)
    ):
        on_panel, at_sample = Length(), on_panel
    unclear = [("source_to_axis", source.problem), ("source_to_detector", panel.problem)]
    findings: list[Finding] = []
    beam = _beam(entry)
    if source.mm is None:
        pixel = at_sample if beam == "parallel" and at_sample.mm else on_panel
        if beam is None and on_panel.mm and at_sample.mm and not _alike(on_panel.mm, at_sample.mm):
            pixel = Length(problem=f"it is {at_sample.mm:.6g} mm at the sample, {on_panel.mm:.6g} mm on the panel")
        if beam == "parallel" and at_sample.mm is None and optical not in (None, 0.0, 1.0):
            pixel = Length(problem=f"whether x_pixel_size is meant before the magnification of {optical:g} or after it")
        elif beam != "parallel" and at_sample.mm is not None and on_panel.mm is None and not on_panel.problem:
            pixel = Length(problem=f"it is {at_sample.mm:.6g} mm at the sample, times the magnification on the panel")
        circle = CircleNumbers(beam=beam, pixel_size=pixel.mm)
        return circle, [*unclear, ("pixel_size", pixel.problem)], findings
    near = abs(source.mm)
    whole = near + abs(panel.mm) if panel.mm is not None else None
    small = at_sample.mm or (on_panel.mm * near / whole if on_panel.mm and whole else None)
    spread = 0.0 if small is None else (max(shape) / 2) ** 2 * small / near
    if beam != "cone" and small is not None and spread < MAX_SPREAD_OF_PARALLEL_RAYS:
        fact = f"the source is {near / 1e3:.4g} m away: the beam was taken as parallel"
        evidence = f"rays diverge by {spread:.2g} pixel over the field"
        findings.append(Finding(Level.NOTE, "sizes", "", fact, evidence))
        return CircleNumbers(beam="parallel", pixel_size=small), unclear, findings
    size, why = (on_panel.mm, on_panel.problem) if at_sample.mm is None else (None, "")
    if at_sample.mm is not None and whole is None:
        why = f"it is {at_sample.mm:.6g} mm at the sample, times the magnification on the panel"
    elif at_sample.mm is not None and whole is not None:
        size = at_sample.mm * whole / near
    elif size is not None and optical not in (None, 0.0, 1.0) and not _alike(optical, whole and whole / near):
        size, why = None, f"whether x_pixel_size is meant before the magnification of {optical:g} or after it"
    circle = CircleNumbers(beam="cone", source_to_axis=near, source_to_detector=whole, pixel_size=size)
    return circle, [*unclear, ("pixel_size", why)], findings


def axis_column(detector: h5py.Group, width: int) -> tuple[float | None, Finding | None]:
    """The column on which the axis is seen, from 0, or why it cannot be told.

    Writers count it from the left (NeXus) or from the middle (the ESRF's, from the motors' places).  A number that is
    near the middle in one of the two ways is that; a scan with the axis at the edge of the panel may be either.
    """
    name, value = next(((n, v) for n in AXIS_NAMES if (v := number_of(detector, n)) is not None), ("", None))
    if value is None or not np.isfinite(value):
        return None, None
    middle = (width - 1) / 2
    half = text_of(detector, "field_of_view").lower() == "half" or bool(number_of(detector, "half_acquisition"))
    if value < 0 and abs(value) < width:
        return middle + value, None
    if not half and abs(value - middle) < NEAR_THE_MIDDLE * width:
        return value, None
    if not half and 0 <= value < NEAR_THE_MIDDLE * width:
        return middle + value, None
    fact = f"{name} is {value:g} of {width} columns: whether from the left or from the middle is not clear"
    remedy = "it was not used; give geometry.axis_offset, in mm"
    return None, Finding(Level.WARNING, "sizes", "", fact, remedy=remedy)


def _beam(entry: h5py.Group) -> Beam | None:
    """The kind of beam that the source has by its kind or place; None if nothing tells it."""
    distance, kind = number_of(entry, "instrument/source/distance"), text_of(entry, "instrument/source/type").lower()
    if any(word in kind for word in ("tube", "anode", "metal jet")):
        return "cone"
    if distance is not None and np.isinf(distance):
        return "parallel"
    return "parallel" if distance in (None, 0.0) and any(word in kind for word in ("synchrotron", "neutron")) else None


def _pixel(entry: h5py.Group, group: str) -> Length:
    """Edge of a pixel."""
    across, up = (length_of(entry, f"{group}/{axis}_pixel_size") for axis in "xy")
    if across.mm is not None and up.mm is not None and abs(across.mm / up.mm - 1) > 1e-3:
        problem = f"{group} has pixels of {across.mm:.5g} x {up.mm:.5g} mm, which are no squares: give a file of views"
        return Length(problem=problem)
    across = up if across == Length() else across
    return across if across.mm is None or across.mm > 0 else Length(problem=f"{group}/x_pixel_size is negative")


def _alike(first: float | None, second: float | None) -> bool:
    return first is not None and second is not None and abs(first / second - 1) < 0.02
