"""Departures of a circular scan from a perfect set-up, and the views of such a scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.rotations import rotation_matrix


@dataclass(frozen=True)
class DetectorAlignment:
    """How the panel and the axis of a circular scan depart from the perfect ones.

    Attributes
    ----------
    offset : (float, float)
        Shift of the panel's centre along u and along v, mm.  A positive first number makes features
        appear further left (at lower columns), a positive second one at lower rows.
    tilts_deg : (float, float, float)
        Rotation of the panel about its own centre, degrees, as a rotation vector in the frame of
        θ = 0: about x (pitch), y (the beam: rotation in its plane) and z (yaw).
    axis_offset : float
        Distance along u (x at θ = 0) by which the rotation axis is off the line from the source to
        the panel's unshifted centre, mm.  A positive value makes features appear further right.
    axis_tilt_deg : (float, float)
        Tilt of the rotation axis about x and about y at θ = 0, degrees.  The sample frame keeps z
        on the axis, so it is the source and the panel that appear tilted the other way.
    first_row : {"bottom", "top"}
        Whether row 0 is the lowest (v along +z, ASTRA) or the highest row (most camera files).
    """

    offset: tuple[float, float] = (0.0, 0.0)
    tilts_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis_offset: float = 0.0
    axis_tilt_deg: tuple[float, float] = (0.0, 0.0)
    first_row: Literal["bottom", "top"] = "bottom"

    def __post_init__(self) -> None:
        if self.first_row not in ("bottom", "top"):
            raise InputError("first_row", f"'{self.first_row}' is unknown", 'use "bottom" or "top"')


def circular_views(
    start: Float,
    center: Float,
    angles_deg: ArrayLike,
    pixel_size: float,
    panel: DetectorAlignment | None,
    *,
    cone: bool,
) -> Float:
    """The 12-vectors of a circular scan.

    ``start`` is the source at 0° of a ``cone`` beam, else the direction of the rays; ``center`` is the panel's.
    """
    panel = panel or DetectorAlignment()
    angles = np.atleast_1d(np.asarray(angles_deg, dtype=float))
    if angles.ndim != 1 or not np.isfinite(angles).all():
        raise InputError("geometry.angles_deg", "not a list of finite numbers", "give one angle a view, in degrees")
    if not pixel_size > 0:
        raise InputError("geometry.pixel_size", f"must be > 0, got {pixel_size}", "give it in mm")
    numbers = [*panel.offset, *panel.tilts_deg, panel.axis_offset, *panel.axis_tilt_deg]
    if not np.isfinite(numbers).all():
        raise InputError("geometry", f"{panel} holds NaN or infinity", "give finite offsets and tilts")
    tilt = rotation_matrix(np.deg2rad(panel.tilts_deg))
    u = tilt @ np.array([pixel_size, 0.0, 0.0])
    v = tilt @ np.array([0.0, 0.0, pixel_size if panel.first_row == "bottom" else -pixel_size])
    center = center + (panel.offset[0] * u + panel.offset[1] * v) / pixel_size
    shift = np.array([-panel.axis_offset, 0.0, 0.0])
    untilt = rotation_matrix(np.deg2rad([*panel.axis_tilt_deg, 0.0])).T
    blocks = [start + shift if cone else start, center + shift, u, v]
    blocks = [untilt @ b for b in blocks]
    rotations = rotation_matrix(np.deg2rad(angles)[:, None] * np.array([0.0, 0.0, 1.0]))
    return np.concatenate([rotations @ b for b in blocks], axis=1)
