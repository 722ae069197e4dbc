"""NXtomo files of the laboratory scanner, written by `nxtomo`, the ESRF's own library (MIT)."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pint
from nxtomo.application.nxtomo import NXtomo
from nxtomo.nxobject.nxdetector import ImageKey
from nxtomo.utils.transformation import DetXFlipTransformation, DetYFlipTransformation

from lab_scanner import Lab

UNITS = pint.get_application_registry()
OPEN_BEAM, DARK_LEVEL = 40_000.0, 100.0


def write_with_nxtomo(
    path: Path, lab: Lab, stage_deg: np.ndarray, *, source_type: str = "Fixed Tube X-ray", distances: bool = True,
    flips: tuple[bool, bool] | None = (False, False), sample_pixel: float | None = None, counter_clockwise: bool = True,
) -> Path:  # fmt: skip
    """Darks, flats, half of the projections, an alignment frame and an invalid one, the rest, and flats again.

    The stage turns the object counter-clockwise by ``stage_deg``.  ``flips``: left to right, upside down, as the camera
    left them; None writes no transformations.  Lengths in the file are metres.
    """
    images = lab.images(stage_deg)
    half = len(stage_deg) // 2
    flat, dark = np.zeros((1, *lab.shape)), np.full((1, *lab.shape), np.inf)
    order = [dark, flat, images[:half], images[:1] + 0.3, flat + 1.0, images[half:], flat]
    keys = [ImageKey.DARK_FIELD, ImageKey.FLAT_FIELD, ImageKey.PROJECTION, ImageKey.ALIGNMENT, ImageKey.INVALID,
            ImageKey.PROJECTION, ImageKey.FLAT_FIELD]  # fmt: skip
    counts = np.round(DARK_LEVEL + OPEN_BEAM * np.exp(-np.concatenate(order)))
    if flips is not None and flips[0]:
        counts = counts[:, :, ::-1]
    if flips is not None and flips[1]:
        counts = counts[:, ::-1]
    sense = 1 if counter_clockwise else -1
    stage = sense * np.asarray(stage_deg, float)
    angles = [stage[:1], stage[:1], stage[:half], stage[:1], stage[:1], stage[half:], stage[-1:]]
    scan = NXtomo()
    scan.title, scan.sample.name = "balls", "four balls"
    detector, source = scan.instrument.detector, scan.instrument.source
    detector.data = counts.astype(np.uint16)
    detector.image_key_control = np.concatenate([[k] * len(o) for k, o in zip(keys, order, strict=True)])
    scan.sample.rotation_angle = np.concatenate(angles) * UNITS.degree
    detector.x_pixel_size = detector.y_pixel_size = lab.pixel * 1e-3 * UNITS.meter
    if sample_pixel is not None:
        scan.sample.x_pixel_size = scan.sample.y_pixel_size = sample_pixel * 1e-3 * UNITS.meter
    source.type, source.name = source_type, "laboratory"
    detector.distance = (lab.source_to_panel - lab.source_to_axis) * 1e-3 * UNITS.meter
    if distances:
        source.distance = -lab.source_to_axis * 1e-3 * UNITS.meter
    if flips is not None:
        detector.transformations.add_transformation(DetYFlipTransformation(flip=flips[0]))
        detector.transformations.add_transformation(DetXFlipTransformation(flip=flips[1]))
    scan.save(str(path), "entry0000")
    if counter_clockwise:
        with h5py.File(path, "a") as file:  # the library does not write the direction of the axis
            file["entry0000/sample/rotation_angle"].attrs["vector"] = (0.0, 1.0, 0.0)
    return path
