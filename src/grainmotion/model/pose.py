"""Pose: where every grain is, and what else moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float


@dataclass(frozen=True, eq=False)
class NuisanceMotion:
    """What moved beside the grains.

    ``views (views, 3)`` are each panel's shift along u and along v (pixels) and the stage's angle (radians);
    ``translation (3,)`` (mm) and ``matrix (3, 3)`` are the background's motion about its centre of mass.
    """

    views: Float
    translation: Float
    matrix: Float

    @classmethod
    def still(cls, views: int) -> NuisanceMotion:
        """Nothing moved."""
        return cls(np.zeros((views, 3)), np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class Pose:
    """Where every grain is: ``translations (n, 3)`` in mm and ``matrices (n, 3, 3)`` about their centres.

    ``surroundings`` says what else moved; None is nothing.
    """

    translations: Float
    matrices: Float
    surroundings: NuisanceMotion | None = None

    def moved(self, translations: Float, matrices: Float) -> Pose:
        """The grains elsewhere, in the same surroundings."""
        return Pose(translations, matrices, self.surroundings)
