"""Beam, distances, size of a pixel and angles of a SkyScan's log; signs are in `grainmotion.io.scanners.bruker`."""

from __future__ import annotations

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers
from grainmotion.io.scanners.key_file import KeyFile, as_number
from grainmotion.model.finding import Finding, Level

ACQ = "Acquisition"
"""The section of a log that describes the scan."""
PARALLEL_FROM_MM = 1e6
"""Object to Source by which logs of a parallel beam tell that it is one, for NRecon."""


def circle_of_log(
    keys: KeyFile, numbers: Float, shape: tuple[float | None, float | None]
) -> tuple[CircleNumbers, tuple[Finding, ...]]:
    """The numbers of the circle, for images with ``numbers``, and what was assumed."""
    told = "Image Pixel Size (um)" if keys.text(ACQ, "Image Pixel Size (um)") else "Scaled Image Pixel Size (um)"
    size = keys.needed(ACQ, told if keys.text(ACQ, told) else "Image Pixel Size (um)") / 1000
    step, start = keys.needed(ACQ, "Rotation Step (deg)"), keys.number(ACQ, "Scanning Start Angle") or 0.0
    direction = keys.text(ACQ, "Rotation Direction").upper() or "CC"
    if direction not in ("CC", "CCW", "CW"):
        fact = f"'{direction}' is unknown; CC and CW are known"
        raise InputError(keys.where(ACQ, "Rotation Direction"), fact, "correct it, seen from above")
    angles = (start + step * numbers) * (1 if direction == "CW" else -1)
    to_axis = keys.needed(ACQ, "Object to Source (mm)")
    if to_axis >= PARALLEL_FROM_MM:
        return CircleNumbers(beam="parallel", pixel_size=size, first_row="top", angles_deg=angles), ()
    found: tuple[Finding, ...] = ()
    if keys.text(ACQ, "Camera to Source (mm)"):
        to_axis, to_camera = keys.distances(ACQ, "Object to Source (mm)", "Camera to Source (mm)")
    else:
        to_camera, found = _assumed_distance(keys, to_axis, size)
    rows, line = shape[0], keys.number(ACQ, "Optical Axis (line)")
    pitch = size * to_camera / to_axis
    circle = CircleNumbers(
        beam="cone",
        source_to_axis=to_axis,
        source_to_detector=to_camera,
        pixel_size=pitch,
        detector_offset=None if line is None or rows is None else (0.0, (line - rows / 2) * pitch),
        first_row="top",
        angles_deg=angles,
    )
    return circle, found


def _assumed_distance(keys: KeyFile, to_axis: float, size: float) -> tuple[float, tuple[Finding, ...]]:
    """A distance of the camera for logs without one: by its pixels, else twice as far as the axis.

    Rays through the sample are the same at any distance, as the pixel's size at the axis is told.
    """
    camera = keys.number("System", "Camera Pixel Size (um)") or 0.0
    binning = as_number(keys.text(ACQ, "Camera binning").lower().split("x")[0]) or 1.0
    by_pixels = to_axis * camera * binning / 1000 / size
    to_camera = by_pixels if by_pixels > to_axis else 2 * to_axis
    fact = f"it is missing; {to_camera:.6g} mm was taken, by which radiographs do not change"
    note = Finding(Level.NOTE, "sizes", keys.where(ACQ, "Camera to Source (mm)"), fact)
    return to_camera, (note,)
