"""NXtomo (NeXus, HDF5): frames of one file, angles, distances, pixel size, axis and flips of the detector.

Facts: the NeXus manual (NXtomo, NXdetector, NXsource: places before the sample are negative; coordinates as in McStas,
z along the beam, y up), and `nxtomo` 3.1 of the ESRF, whose files of version 2 keep these coordinates, while older ones
have x along the beam and z up.  There, since version 1.5, ``sample/x_pixel_size`` is a pixel at the sample and
``detector/x_pixel_size`` one of the panel; before, the latter was one at the sample.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import h5py
import numpy as np

from grainmotion._typing import Beam
from grainmotion.io.hdf5 import NXtomo, nxtomo_entries, opened, read_nxtomo
from grainmotion.io.hdf5_numbers import Length, length_of, number_of, numbers_of, text_of
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.nxtomo_detector import Flips, axis_column, flips_of, version_of
from grainmotion.model.finding import Finding, Level

MAX_SPREAD_OF_PARALLEL_RAYS = 0.1
"""Rays of a source so far away that they diverge by less than this over the field, pixels, are parallel."""
SAMPLE_PIXEL_SINCE = 1.5
"""Version of the ESRF's files from which ``detector/x_pixel_size`` is one of the panel."""
DETECTOR = "instrument/detector"


def read_nxtomo_scan(path: Path) -> ScannerFile:
    """What an NXtomo file tells about its scan."""
    file = read_nxtomo(path)
    with opened(path) as content:
        entry = content[file.entry]
        flips = flips_of(entry, path)
        circle, unclear, findings = _optics(entry, file)
        axis, unused = axis_column(entry[DETECTOR], file.shape[1])
        distance = length_of(entry, f"{DETECTOR}/distance")
        facts = _facts(entry)
        others = [name for name in nxtomo_entries(content) if name != file.entry]
    if others:
        fact, remedy = (
            f"the scan {file.entry} was read; it also holds {', '.join(others)}",
            "copy another to its own file",
        )
        findings.append(Finding(Level.NOTE, "kind", "", fact, remedy=remedy))
    findings += [*flips.findings, *((unused,) if unused else ())]
    if axis is not None and circle.pixel_size is not None:
        right = axis - (file.shape[1] - 1) / 2
        offset = circle.pixel_size * (right if flips.mirrored else -right)
        circle = replace(circle, detector_offset=(offset, 0.0))
        facts.append(("Rotation axis", f"column {axis:g}"))
    rows: Literal["top", "bottom"] | None = {True: "bottom", False: "top", None: None}[flips.upside_down]
    facts += [] if rows is None else [("First row", f"{rows} of the sample, by the flips of the detector")]
    circle = replace(circle, first_row=rows, angles_deg=_angles(file, flips))
    return ScannerFile(
        path,
        "NXtomo",
        circle,
        radiographs=(str(path),),
        mirrored=bool(flips.mirrored),
        axis_to_detector=abs(distance.mm) if distance.mm else None,
        unclear=tuple((key, why) for key, why in unclear if why),
        facts=tuple(facts),
        findings=tuple(replace(finding, where=str(path)) for finding in findings),
    )


def _angles(file: NXtomo, flips: Flips) -> np.ndarray | None:
    """Angles of the projections in the package's sense, if the file has them all."""
    angles = file.projection_angles_deg
    sense = -1 if flips.counter_clockwise else 1
    return sense * angles if len(angles) and np.isfinite(angles).all() else None


def _optics(entry: h5py.Group, file: NXtomo) -> tuple[CircleNumbers, list[tuple[str, str]], list[Finding]]:
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
        if beam == "parallel" and at_sample.mm is None and optical not in (None, 0.0, 1.0):
            pixel = Length(problem=f"whether x_pixel_size is meant before the magnification of {optical:g} or after it")
        elif beam != "parallel" and at_sample.mm is not None and on_panel.mm is None:
            pixel = Length(problem=f"it is {at_sample.mm:.6g} mm at the sample, times the magnification on the panel")
        circle = CircleNumbers(beam=beam, pixel_size=pixel.mm)
        return circle, [*unclear, ("pixel_size", pixel.problem)], findings
    near = abs(source.mm)
    whole = near + abs(panel.mm) if panel.mm is not None else None
    small = at_sample.mm or (on_panel.mm * near / whole if on_panel.mm and whole else None)
    spread = 0.0 if small is None else (max(file.shape) / 2) ** 2 * small / near
    if beam != "cone" and small is not None and spread < MAX_SPREAD_OF_PARALLEL_RAYS:
        fact = f"the source is {near / 1e3:.4g} m away: the beam was taken as parallel"
        evidence = f"rays diverge by {spread:.2g} pixel over the field"
        findings.append(Finding(Level.NOTE, "sizes", "", fact, evidence))
        return CircleNumbers(beam="parallel", pixel_size=small), unclear, findings
    size, why = (on_panel.mm, on_panel.problem) if at_sample.mm is None else (None, "")
    if at_sample.mm is not None and whole is not None:
        size = at_sample.mm * whole / near
    elif size is not None and optical not in (None, 0.0, 1.0) and not _alike(optical, whole and whole / near):
        size, why = None, f"whether x_pixel_size is meant before the magnification of {optical:g} or after it"
    circle = CircleNumbers(beam="cone", source_to_axis=near, source_to_detector=whole, pixel_size=size)
    return circle, [*unclear, ("pixel_size", why)], findings


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
    return across if across.mm is None or across.mm > 0 else Length(problem=f"{group}/x_pixel_size is negative")


def _alike(first: float | None, second: float | None) -> bool:
    return first is not None and second is not None and abs(first / second - 1) < 0.02


def _facts(entry: h5py.Group) -> list[tuple[str, str]]:
    """What a user wants to see of the scan."""
    names = {"Sample": "sample/name", "Title": "title", "Start": "start_time", "Source": "instrument/source/name"}
    facts = [(label, text_of(entry, name)) for label, name in names.items()]
    energy = numbers_of(entry, "instrument/beam/incident_energy")
    if energy is not None:
        unit = entry["instrument/beam/incident_energy"].attrs.get("units", "")
        facts.append(("Energy", f"{energy[0]:g} {unit}".strip()))
    distance = length_of(entry, "sample/propagation_distance").mm
    facts.append(("Propagation distance", "" if distance is None else f"{distance:g} mm"))
    return [(label, text) for label, text in facts if text]
