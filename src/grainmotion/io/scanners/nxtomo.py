"""NXtomo (NeXus, HDF5): frames of one file, angles, distances, pixel size, axis and flips of the detector.

Facts: the NeXus manual (NXtomo, NXdetector, NXsource: places before the sample are negative; coordinates as in McStas,
z along the beam, y up), and `nxtomo` 3.1 of the ESRF.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import h5py
import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.hdf5 import PROJECTION, NXtomo, nxtomo_entries, opened, read_nxtomo
from grainmotion.io.hdf5_numbers import length_of, numbers_of, text_of
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.nxtomo_detector import Flips, flips_of
from grainmotion.io.scanners.nxtomo_optics import DETECTOR, axis_column, optics_of
from grainmotion.model.finding import Finding, Level


def read_nxtomo_scan(path: Path) -> ScannerFile:
    """What an NXtomo file tells about its scan."""
    file = read_nxtomo(path)
    if not file.count(PROJECTION):
        fact = f"no frame of {file.entry} is a radiograph, of image_key 0"
        raise InputError(str(path), fact, "give the file of the scan; one of flats alone serves as flats")
    with opened(path) as content:
        entry = content[file.entry]
        flips = flips_of(entry, path)
        circle, unclear, findings = optics_of(entry, file.shape)
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
        right = circle.pixel_size * (axis - (file.shape[1] - 1) / 2) * (-1 if flips.mirrored else 1)
        facts.append(("Rotation axis", f"column {axis:g}"))
        if circle.beam == "parallel" or (circle.source_to_axis and circle.source_to_detector):
            shrunk = (circle.source_to_axis or 1.0) / (circle.source_to_detector or 1.0)
            circle = replace(circle, axis_offset=right * shrunk)
        else:
            circle = replace(circle, detector_offset=(-right, 0.0))  # the magnification is not known
    rows: Literal["top", "bottom"] | None = {True: "bottom", False: "top", None: None}[flips.upside_down]
    facts += [] if rows is None else [("First row", f"{rows} of the sample, by the flips of the detector")]
    angles, why = _angles(file, flips)
    circle = replace(circle, first_row=rows, angles_deg=angles)
    return ScannerFile(
        path,
        "NXtomo",
        circle,
        radiographs=(str(path),),
        mirrored=bool(flips.mirrored),
        axis_to_detector=abs(distance.mm) if distance.mm else None,
        unclear=tuple((key, why) for key, why in (*unclear, ("angles_deg", why)) if why),
        facts=tuple(facts),
        findings=tuple(replace(finding, where=str(path)) for finding in findings),
    )


def _angles(file: NXtomo, flips: Flips) -> tuple[Float | None, str]:
    """Angles of the projections in the package's sense, or why the file does not tell them."""
    angles = file.projection_angles_deg
    lost = int((~np.isfinite(angles)).sum())
    if lost:
        return None, f"sample/rotation_angle is {'not there' if lost == len(angles) else f'no number in {lost} frames'}"
    return (-1 if flips.counter_clockwise else 1) * angles + 0.0, ""


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
