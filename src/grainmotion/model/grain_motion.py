"""The motion of one grain, as a row of `Motions`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.summary import Summarised, Summary, vector_text
from grainmotion.rotations import rotation_matrix


@dataclass(frozen=True, eq=False, repr=False)
class GrainMotion(Summarised):
    """Motion of one grain from the reference to one state: ``motions[label]``, or an item of ``for grain in motions``.

    Attributes
    ----------
    label : int
        In the reference volume.
    status : str
        Outcome of its fit, see `Status`.
    center : (3,) array
        Centre of mass in the reference state, mm, x y z.
    translation, rotation : (3,) arrays
        u, mm, and the rotation vector ω about the centre, radians.
    covariance : (6, 6) array
        Of (ux, uy, uz, ωx, ωy, ωz), mm and radians.
    residual : float
        Root mean square of (measured − simulated) over its footprint.
    reason : str
        Cause and remedy; empty if it converged.
    ok_translation, ok_rotation : bool
        Whether u, and whether ω, is a result to use.
    strain : (6,) array, optional
        Biot strain, as in `Motions.strains`; None for a grain taken as rigid.

    Examples
    --------
    >>> motion = motions[1]
    >>> motion.status, motion.ok_translation
    ('converged', True)
    """

    label: int
    status: str
    center: Float
    translation: Float
    rotation: Float
    covariance: Float
    residual: float
    reason: str
    ok_translation: bool
    ok_rotation: bool
    strain: Float | None = None

    @property
    def rotation_deg(self) -> Float:
        """Rotation vector ω ``(3,)``, degrees."""
        return np.asarray(np.rad2deg(self.rotation))

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation, degrees."""
        return float(np.rad2deg(np.linalg.norm(self.rotation)))

    @property
    def matrix(self) -> Float:
        """Rotation matrix Ω ``(3, 3)``."""
        return rotation_matrix(self.rotation)

    @property
    def translation_sd(self) -> Float:
        """Standard deviations of u ``(3,)``, mm."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)[:3]))

    @property
    def rotation_sd_deg(self) -> Float:
        """Standard deviations of ω ``(3,)``, degrees."""
        return np.asarray(np.rad2deg(np.sqrt(np.diagonal(self.covariance)[3:])))

    def _summary(self) -> Summary:
        unused = [n for n, ok in (("translation", self.ok_translation), ("rotation", self.ok_rotation)) if not ok]
        rows = [
            ("centre", f"{vector_text(self.center)} mm"),
            ("translation", f"{vector_text(self.translation)} mm, sd {vector_text(self.translation_sd)}"),
            ("rotation", f"{vector_text(self.rotation_deg)}°, sd {vector_text(self.rotation_sd_deg)}"),
        ]
        rows += [("strain", vector_text(self.strain))] if self.strain is not None else []
        rows += [("not a result to use", " and ".join(unused))] if unused else []
        rows += [("reason", self.reason)] if self.reason else []
        line = f"u = {vector_text(self.translation)} mm, ω = {vector_text(self.rotation_deg)}°"
        return Summary(f"Motion of grain {self.label}", line, tuple(rows), counts={self.status: 1})
