"""Corrections of panel and axis, each in the frame of a view's own panel: they apply to any scan of the scanner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from pydantic.dataclasses import dataclass
from typing_extensions import deprecated

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.summary import Summarised, Summary
from grainmotion.rotations import rotation_matrix

Parameter = Literal["shift_u", "shift_v", "turn", "pitch", "yaw", "axis_offset", "axis_tilt"]

PARAMETERS: tuple[Parameter, ...] = get_args(Parameter)
DEFAULT_PARAMETERS: tuple[Parameter, ...] = ("shift_u", "turn", "axis_tilt")
LENGTHS = ("shift_u", "shift_v", "axis_offset")
SIGNIFICANT_SD = 3.0
"""Standard deviations from which a correction is significant."""
SIGNIFICANT_RESIDUAL = 0.97
"""Corrections count as significant only if the residual falls below this share of what it was."""
LARGEST_TILT = np.deg2rad(10.0)
"""Largest unit of pitch and yaw, radians: in a parallel beam they have no effect."""


@dataclass(frozen=True)
class Correction:
    """One number by which the scanner departs from the nominal geometry.

    Attributes
    ----------
    name : Parameter
    amount : float
        mm or radians, signs as in `DetectorAlignment`; 0 if the data do not determine it.
    amount_sd : float
        Its standard deviation, with the share of model error; infinite if the data do not determine it.
    """

    name: Parameter
    amount: float
    amount_sd: float

    @property
    def unit(self) -> str:
        """Unit in tables and files, "mm" or "degrees"."""
        return "mm" if self.name in LENGTHS else "degrees"

    @property
    def in_unit(self) -> tuple[float, float]:
        """Amount and standard deviation in `unit`."""
        return in_table_unit(self.name, self.amount), in_table_unit(self.name, self.amount_sd)

    @property
    def determined(self) -> bool:
        """Whether the data determine it."""
        return bool(np.isfinite(self.amount_sd))

    @property
    @deprecated("Correction.value (mm or degrees) is now Correction.amount (mm or radians)")
    def value(self) -> float:
        """Amount, mm or degrees."""
        return self.in_unit[0]

    @property
    @deprecated("Correction.sd (mm or degrees) is now Correction.amount_sd (mm or radians)")
    def sd(self) -> float:
        """Standard deviation, mm or degrees."""
        return self.in_unit[1]

    def __str__(self) -> str:
        if not self.determined:
            return f"{self.name} not determined"
        amount, sd = self.in_unit
        return f"{self.name} {amount:.4f} ± {sd:.4f} {self.unit}"


@dataclass(frozen=True, repr=False, config={"arbitrary_types_allowed": True})
class Calibration(Summarised):
    """Corrections of a scan's geometry, estimated from the scan itself.

    Attributes
    ----------
    geometry : Geometry
        The scan's, corrected.
    corrections : tuple of Correction
        In the order asked for, with those that the data do not determine.
    residuals : (float, float)
        Relative residual of half the views against the other half, ‖r‖/‖b‖, before and after.

    Examples
    --------
    >>> views = case.scanner.geometry((0, 90))
    >>> as_given = gm.Calibration.of(views, (), residuals=(0.02, 0.02))  # nothing to correct
    >>> np.array_equal(as_given.apply(views).vectors, views.vectors)
    True
    """

    geometry: Geometry
    corrections: tuple[Correction, ...]
    residuals: tuple[float, float]

    @classmethod
    def of(cls, nominal: Geometry, corrections: tuple[Correction, ...], residuals: tuple[float, float]) -> Calibration:
        """The nominal geometry of a scan with its corrections.

        Parameters
        ----------
        nominal : Geometry
            As given for the scan.
        corrections : tuple of Correction
            What to correct.
        residuals : (float, float)
            Before and after, see `Calibration`.

        Returns
        -------
        Calibration
            With the corrected geometry.
        """
        return cls(corrected(nominal, {c.name: c.amount for c in corrections}), corrections, residuals)

    @property
    def amounts(self) -> dict[str, float]:
        """The corrections, mm and radians, by name."""
        return {c.name: c.amount for c in self.corrections}

    @property
    @deprecated("Calibration.values (mm and degrees) is now Calibration.amounts (mm and radians)")
    def values(self) -> dict[str, float]:
        """The corrections, mm and degrees, by name."""
        return {c.name: c.in_unit[0] for c in self.corrections}

    def significant(self, nominal: Geometry) -> Calibration:
        """Keep the significant corrections, and set the others to zero.

        Parameters
        ----------
        nominal : Geometry
            As given for the scan.

        Returns
        -------
        Calibration
            With every correction of less than three standard deviations at zero, and all of them where the residual
            hardly falls.
        """
        before, after = self.residuals
        better = after < SIGNIFICANT_RESIDUAL * before
        kept = [better and abs(c.amount) > SIGNIFICANT_SD * c.amount_sd for c in self.corrections]
        rows = tuple(c if k else replace(c, amount=0.0) for c, k in zip(self.corrections, kept, strict=True))
        return Calibration.of(nominal, rows, (before, after if any(kept) else before))

    clear = deprecated("Calibration.clear is now Calibration.significant")(significant)

    def apply(self, geometry: Geometry) -> Geometry:
        """Correct the geometry of another scan of the same scanner.

        Parameters
        ----------
        geometry : Geometry
            Nominal geometry of that scan.

        Returns
        -------
        Geometry
            The same views with panel and axis where the calibration puts them.
        """
        return corrected(geometry, self.amounts)

    def __str__(self) -> str:
        before, after = self.residuals
        return f"{', '.join(map(str, self.corrections))}; residual {before:.4f} → {after:.4f}"

    def _summary(self) -> Summary:
        rows = [("corrections", ", ".join(map(str, self.corrections)) or "none")]
        rows += [("residual", f"{self.residuals[0]:.4g} before, {self.residuals[1]:.4g} after")]
        return Summary("Calibration", "; ".join(value for _, value in rows), tuple(rows))


def in_table_unit(name: str, amount: float) -> float:
    """A length in mm, or an angle in degrees rounded to 12 decimals, so that a file gives back the same number."""
    return amount if name in LENGTHS else round(float(np.rad2deg(amount)), 12)


def from_table_unit(name: str, value: float) -> float:
    """A value of a table, mm or degrees, in mm or radians."""
    return value if name in LENGTHS else float(np.deg2rad(value))


def corrected(geometry: Geometry, amounts: Mapping[str, float]) -> Geometry:
    """Views whose panel and axis are off by ``amounts``, in each panel's own frame.

    Parameters
    ----------
    geometry : Geometry
    amounts : dict of Parameter to float
        ``shift_u``, ``shift_v``: of the panel's centre along u and v, mm.  ``pitch``, ``turn``, ``yaw``: rotation
        vector of the panel about its centre, radians, about its u, the beam's normal incidence and their upward
        normal.  ``axis_offset``: of the axis along u, mm.  ``axis_tilt``: of the axis about u, radians; its tilt
        about the beam has the effect of ``turn``.  For a circular scan they are the numbers of `DetectorAlignment`,
        with angles in radians.
    """
    unknown = set(amounts) - set(PARAMETERS)
    if unknown:
        raise InputError("calibrate", f"{sorted(unknown)} are no corrections", f"choose from {', '.join(PARAMETERS)}")
    x: dict[str, float] = {name: float(amounts.get(name, 0.0)) for name in PARAMETERS}
    along = geometry.u / np.linalg.norm(geometry.u, axis=1, keepdims=True)
    normal = geometry.normals
    normal *= np.sign((normal * geometry.rays).sum(1, keepdims=True)) / np.linalg.norm(normal, axis=1, keepdims=True)
    rotations = rotation_matrix(x["pitch"] * along + x["turn"] * normal + x["yaw"] * np.cross(along, normal))
    u, v = (np.einsum("nij,nj->ni", rotations, step) for step in (geometry.u, geometry.v))
    axis_shift = -x["axis_offset"] * along
    d = geometry.detector + axis_shift
    for name, step in (("shift_u", u), ("shift_v", v)):
        d = d + x[name] * step / np.linalg.norm(step, axis=1, keepdims=True)
    s = geometry.source + axis_shift if geometry.beam == "cone" else geometry.source
    untilt = rotation_matrix(-x["axis_tilt"] * along)
    blocks = [np.einsum("nij,nj->ni", untilt, block) for block in (s, d, u, v)]
    return Geometry(np.concatenate(blocks, axis=1), geometry.shape, geometry.beam)


def step_of_a_pixel(name: Parameter, geometry: Geometry) -> float:
    """The correction, mm or radians, that moves the edge of a footprint by about one pixel."""
    pixel = float(geometry.pixel_sizes[:, 1].mean())
    if name in LENGTHS:
        return pixel
    half = geometry.shape[1] / 2
    if name in ("turn", "axis_tilt"):
        return 1 / half
    if geometry.beam == "parallel":
        return LARGEST_TILT
    distance = float(np.linalg.norm(geometry.rays, axis=1).mean())
    return float(min(distance / (pixel * half**2), LARGEST_TILT))
