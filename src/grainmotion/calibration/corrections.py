"""Corrections of panel and axis, each in the frame of a view's own panel, so that they fit any scan of a machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from pydantic.dataclasses import dataclass

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix

Parameter = Literal["shift_u", "shift_v", "turn", "pitch", "yaw", "axis_offset", "axis_tilt"]

PARAMETERS: tuple[Parameter, ...] = get_args(Parameter)
DEFAULT: tuple[Parameter, ...] = ("shift_u", "turn", "axis_tilt")
LENGTHS = ("shift_u", "shift_v", "axis_offset")
CLEAR, CLEARLY_BETTER = 3.0, 0.97
"""Standard deviations from which a correction is beyond doubt; share of the residual that must not be left then."""


@dataclass(frozen=True)
class Correction:
    """One number by which the machine departs from the geometry that was told.

    Attributes
    ----------
    name : Parameter
    value : float
        mm or degrees, signs as in `DetectorAlignment`; 0 if the data do not tell.
    sd : float
        Its standard deviation, with the share of model error; infinite if the data do not tell.
    """

    name: Parameter
    value: float
    sd: float

    @property
    def unit(self) -> str:
        """Its unit, "mm" or "degrees"."""
        return "mm" if self.name in LENGTHS else "degrees"

    @property
    def determined(self) -> bool:
        """Whether the data tell it."""
        return bool(np.isfinite(self.sd))

    def __str__(self) -> str:
        if not self.determined:
            return f"{self.name} not determined"
        return f"{self.name} {self.value:.4f} ± {self.sd:.4f} {self.unit}"


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Calibration:
    """What a scan says of its own geometry.

    Attributes
    ----------
    geometry : Geometry
        The scan's, corrected.
    corrections : tuple of Correction
        In the order asked for, those that the data do not tell included.
    residuals : (float, float)
        Relative residual of half the views against the other half, ‖r‖/‖b‖, before and after.
    """

    geometry: Geometry
    corrections: tuple[Correction, ...]
    residuals: tuple[float, float]

    @property
    def values(self) -> dict[str, float]:
        """The corrections, mm and degrees, by name."""
        return {c.name: c.value for c in self.corrections}

    def clear(self, told: Geometry) -> Calibration:
        """Only those corrections of the told geometry that are beyond doubt, the others zero."""
        before, after = self.residuals
        better = after < CLEARLY_BETTER * before
        kept = [better and abs(c.value) > CLEAR * c.sd for c in self.corrections]
        found = tuple(replace(c, value=c.value if k else 0.0) for c, k in zip(self.corrections, kept, strict=True))
        values: dict[str, float] = {c.name: c.value for c in found}
        return Calibration(corrected(told, values), found, (before, after if any(kept) else before))

    def apply(self, geometry: Geometry) -> Geometry:
        """Correct the geometry of another scan of the same machine."""
        return corrected(geometry, self.values)

    def __str__(self) -> str:
        before, after = self.residuals
        return f"{', '.join(map(str, self.corrections))}; residual {before:.4f} → {after:.4f}"


def corrected(geometry: Geometry, values: Mapping[str, float]) -> Geometry:
    """Views whose panel and axis are off by ``values``, in each panel's own frame.

    Parameters
    ----------
    geometry : Geometry
    values : dict of Parameter to float
        ``shift_u``, ``shift_v``: of the panel's centre along u and v, mm.  ``pitch``, ``turn``, ``yaw``: rotation
        vector of the panel about its centre, degrees, about its u, the beam's normal incidence and their upward
        normal.  ``axis_offset``: of the axis along u, mm.  ``axis_tilt``: of the axis about u, degrees; its tilt
        about the beam is the panel's turn.  Of a perfect circular scan they are the numbers of `DetectorAlignment`.
    """
    unknown = set(values) - set(PARAMETERS)
    if unknown:
        raise InputError("calibrate", f"{sorted(unknown)} are no corrections", f"choose from {', '.join(PARAMETERS)}")
    x: dict[str, float] = {name: float(values.get(name, 0.0)) for name in PARAMETERS}
    along = geometry.u / np.linalg.norm(geometry.u, axis=1, keepdims=True)
    normal = geometry.normals
    normal *= np.sign((normal * geometry.rays).sum(1, keepdims=True)) / np.linalg.norm(normal, axis=1, keepdims=True)
    tilts = np.deg2rad([x["pitch"], x["turn"], x["yaw"]])
    turns = rotation_matrix(tilts[0] * along + tilts[1] * normal + tilts[2] * np.cross(along, normal))
    u, v = (np.einsum("nij,nj->ni", turns, step) for step in (geometry.u, geometry.v))
    aside = -x["axis_offset"] * along
    d = geometry.detector + aside
    for name, step in (("shift_u", u), ("shift_v", v)):
        d = d + x[name] * step / np.linalg.norm(step, axis=1, keepdims=True)
    s = geometry.source + aside if geometry.beam == "cone" else geometry.source
    untilt = rotation_matrix(-np.deg2rad(x["axis_tilt"]) * along)
    blocks = [np.einsum("nij,nj->ni", untilt, block) for block in (s, d, u, v)]
    return Geometry(np.concatenate(blocks, axis=1), geometry.shape, geometry.beam)


def unit(name: Parameter, geometry: Geometry) -> float:
    """The correction, mm or degrees, that moves the edge of a shadow by about one pixel."""
    pixel = float(geometry.pixel_sizes[:, 1].mean())
    if name in LENGTHS:
        return pixel
    half = geometry.shape[1] / 2
    if name in ("turn", "axis_tilt"):
        return float(np.rad2deg(1 / half))
    if geometry.beam == "parallel":
        return 10.0
    distance = float(np.linalg.norm(geometry.rays, axis=1).mean())
    return float(min(np.rad2deg(distance / (pixel * half**2)), 10.0))
