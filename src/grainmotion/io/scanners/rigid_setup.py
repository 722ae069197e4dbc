"""A circular scan from where source, panel and axis stand, given as vectors in any right-handed frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.rotations import rotation_vector

MIN_DETERMINANT = 0.05
"""Of the directions of rows, columns and beam, unit length: a panel that is turned so far sees no sample."""
MIN_SOURCE_SHARE = 1e-6
"""Distance of the source from the axis over that from the panel, below which it is zero but for rounding."""


@dataclass(frozen=True, eq=False)
class RigidSetup:
    """Source and panel while the sample turns about an axis through the origin; mm.

    Attributes
    ----------
    source, center : (3,) array
        Of the panel, its geometric centre.
    u, v : (3,) array
        Directions from column to column and from row to row, unit length.
    up : (3,) array
        Direction of the axis, upwards.
    """

    source: Float
    center: Float
    u: Float
    v: Float
    up: Float


class SetupNumbers(TypedDict):
    """What a rigid set-up tells of `grainmotion.io.scanners.description.CircleNumbers`."""

    source_to_axis: float
    source_to_detector: float
    detector_offset: tuple[float, float]
    detector_tilts_deg: tuple[float, float, float]
    axis_offset: float
    first_row: Literal["top", "bottom"]


def circle_numbers(where: str, setup: RigidSetup) -> tuple[SetupNumbers, bool]:
    """The numbers of the circular scan, and whether its images are seen from behind.

    z leads up along the axis, y along the panel's normal as far as it is across the axis, and z = 0 is the source's
    height.
    """
    z = setup.up / np.linalg.norm(setup.up)
    normal = np.cross(setup.u, setup.v)
    normal = normal - (normal @ z) * z
    y = normal / np.linalg.norm(normal) if normal.any() else np.zeros(3)
    y = y if setup.source @ y <= 0 else -y
    frame = np.stack([np.cross(y, z), y, z])
    source, u, v = frame @ setup.source, frame @ setup.u, frame @ setup.v
    to_center = frame @ (setup.center - setup.source)
    first_row: Literal["top", "bottom"] = "bottom" if v[2] > 0 else "top"
    down = -v if first_row == "bottom" else v
    mirrored = bool(np.cross(u, down)[1] < 0)
    right = -u if mirrored else u
    tilt = np.stack([right, np.cross(right, down), -down], axis=1)
    skew = np.stack([right, v, [0.0, 1.0, 0.0]], axis=1)
    if not -source[1] > MIN_SOURCE_SHARE * np.linalg.norm(to_center) or abs(np.linalg.det(skew)) < MIN_DETERMINANT:
        fact = "the source lies on the rotation axis, or the panel along the beam"
        raise InputError(where, fact, "repeat the geometry calibration, or give the views as a file")
    along_u, along_v, depth = np.linalg.solve(skew, to_center)
    if not depth > -source[1]:
        fact = f"the panel is {depth:.5g} mm from the source, and the axis {-source[1]:.5g} mm"
        raise InputError(where, fact, "repeat the geometry calibration, or give the views as a file")
    tilts = np.rad2deg(rotation_vector(tilt))
    return {
        "source_to_axis": float(-source[1]),
        "source_to_detector": float(depth),
        "detector_offset": (float(along_u), float(along_v)),
        "detector_tilts_deg": (float(tilts[0]), float(tilts[1]), float(tilts[2])),
        "axis_offset": float(-source[0]),
        "first_row": first_row,
    }, mirrored
