"""Pose: place and rotation of every grain, and the motions of views and bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.summary import Summarised


@dataclass(frozen=True, eq=False, repr=False)
class ViewCorrections(Summarised):
    """Departure of each view from its geometry, or its standard deviations.

    Attributes
    ----------
    shifts_pixels : (views, 2) array
        Shift of the panel along u and along v, pixels.
    angles : (views,) array
        Excess rotation of the stage, radians.
    """

    shifts_pixels: Float
    angles: Float

    @classmethod
    def of(cls, columns: Float) -> ViewCorrections:
        """From the columns shift along u, shift along v, angle, ``(views, 3)``."""
        return cls(columns[:, :2], columns[:, 2])

    @property
    def columns(self) -> Float:
        """Shift along u, shift along v (pixels) and angle (radians), ``(views, 3)``."""
        return np.column_stack([self.shifts_pixels, self.angles])


@dataclass(frozen=True, eq=False)
class NuisanceMotion:
    """Motions beside those of the grains: of views, and of k bodies about their centres of mass.

    ``translations (k, 3)`` (mm) and ``matrices (k, 3, 3)`` are the bodies'.
    """

    views: ViewCorrections
    translations: Float
    matrices: Float

    @classmethod
    def still(cls, views: int, bodies: int = 0) -> NuisanceMotion:
        """No motion."""
        corrections = ViewCorrections.of(np.zeros((views, 3)))
        return cls(corrections, np.zeros((bodies, 3)), np.tile(np.eye(3), (bodies, 1, 1)))


@dataclass(frozen=True, eq=False)
class Pose:
    """Motions of all grains: ``translations (n, 3)`` in mm and ``matrices (n, 3, 3)`` about their centres.

    ``nuisance`` are motions beside those of the grains; None for none.
    """

    translations: Float
    matrices: Float
    nuisance: NuisanceMotion | None = None

    def moved(self, translations: Float, matrices: Float) -> Pose:
        """Another pose of the grains, with the same nuisance motions."""
        return Pose(translations, matrices, self.nuisance)
