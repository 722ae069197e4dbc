"""Departures of a circular scan from a perfect set-up, and the views of such a scan."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import deprecated

from grainmotion._arguments import renamed_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.rotations import rotation_matrix

FirstRow = Literal["bottom", "top"]


@dataclass(frozen=True)
class DetectorAlignment:
    """How the panel and the axis of a circular scan depart from the perfect ones.

    Attributes
    ----------
    detector_offset : (float, float)
        Shift of the panel's centre along u and along v, mm.  A positive first number makes features
        appear further left (at lower columns), a positive second one at lower rows.
    detector_tilts_deg : (float, float, float)
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

    Examples
    --------
    A panel that is shifted by 0.1 mm along its rows, whose row 0 is its upper one:

    >>> gm.DetectorAlignment(detector_offset=(0.1, 0.0), first_row="top").detector_offset
    (0.1, 0.0)
    """

    detector_offset: tuple[float, float] = (0.0, 0.0)
    detector_tilts_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis_offset: float = 0.0
    axis_tilt_deg: tuple[float, float] = (0.0, 0.0)
    first_row: FirstRow = "bottom"

    def __post_init__(self) -> None:
        if self.first_row not in ("bottom", "top"):
            raise InputError("first_row", f"'{self.first_row}' is unknown", 'use "bottom" or "top"')

    @property
    @deprecated("DetectorAlignment.offset is now DetectorAlignment.detector_offset")
    def offset(self) -> tuple[float, float]:
        """As `detector_offset`."""
        return self.detector_offset

    @property
    @deprecated("DetectorAlignment.tilts_deg is now DetectorAlignment.detector_tilts_deg")
    def tilts_deg(self) -> tuple[float, float, float]:
        """As `detector_tilts_deg`."""
        return self.detector_tilts_deg


DetectorAlignment.__init__ = renamed_arguments(  # type: ignore[method-assign]
    offset="detector_offset", tilts_deg="detector_tilts_deg"
)(DetectorAlignment.__init__)


class AlignmentKeys(TypedDict, total=False):
    """Keywords of `Geometry.cone` and `Geometry.parallel`: the fields of `DetectorAlignment`."""

    detector_offset: tuple[float, float]
    detector_tilts_deg: tuple[float, float, float]
    axis_offset: float
    axis_tilt_deg: tuple[float, float]
    first_row: FirstRow


def panel_of(where: str, panel: DetectorAlignment | None, keys: AlignmentKeys) -> DetectorAlignment:
    """The alignment that is given as a record, or by its fields."""
    unknown = sorted(set(keys) - set(AlignmentKeys.__annotations__))
    if unknown:
        near = difflib.get_close_matches(unknown[0], AlignmentKeys.__annotations__, n=1, cutoff=0.4)
        remedy = f"did you mean '{near[0]}'?" if near else f"known ones are {', '.join(AlignmentKeys.__annotations__)}"
        raise InputError(f"{where}({unknown[0]})", "unknown argument", remedy)
    if panel is not None and keys:
        raise InputError(f"{where}(panel)", f"got panel and {', '.join(keys)}", "give one or the other")
    return DetectorAlignment(**keys) if panel is None else panel


def circular_views(
    start: Float,
    center: Float,
    angles_deg: ArrayLike,
    pixel_size: float,
    panel: DetectorAlignment,
    *,
    cone: bool,
) -> Float:
    """The 12-vectors of a circular scan.

    ``start`` is the source at 0° of a ``cone`` beam, else the direction of the rays; ``center`` is the panel's.
    """
    angles = np.atleast_1d(np.asarray(angles_deg, dtype=float))
    if angles.ndim != 1 or not np.isfinite(angles).all():
        raise InputError("geometry.angles_deg", "not a list of finite numbers", "give one angle a view, in degrees")
    if not pixel_size > 0:
        raise InputError("geometry.pixel_size", f"must be > 0, got {pixel_size}", "give it in mm")
    numbers = [*panel.detector_offset, *panel.detector_tilts_deg, panel.axis_offset, *panel.axis_tilt_deg]
    if not np.isfinite(numbers).all():
        raise InputError("geometry", f"{panel} holds NaN or infinity", "give finite offsets and tilts")
    tilt = rotation_matrix(np.deg2rad(panel.detector_tilts_deg))
    u = tilt @ np.array([pixel_size, 0.0, 0.0])
    v = tilt @ np.array([0.0, 0.0, pixel_size if panel.first_row == "bottom" else -pixel_size])
    center = center + (panel.detector_offset[0] * u + panel.detector_offset[1] * v) / pixel_size
    shift = np.array([-panel.axis_offset, 0.0, 0.0])
    untilt = rotation_matrix(np.deg2rad([*panel.axis_tilt_deg, 0.0])).T
    blocks = [start + shift if cone else start, center + shift, u, v]
    blocks = [untilt @ b for b in blocks]
    rotations = rotation_matrix(np.deg2rad(angles)[:, None] * np.array([0.0, 0.0, 1.0]))
    return np.concatenate([rotations @ b for b in blocks], axis=1)
