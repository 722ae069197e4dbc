"""How far grains may move: what tracking was measured to capture, and what the panel holds.

The ranges are those of `docs/paper.md`, "Capture in three dimensions: 15 grains": touching gravel, noise of 1 %
of the largest line integral, views evenly over 180°, default settings, zero start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.geometry import Geometry
from grainmotion.projection.grain_arrays import GrainArrays, planar

CAPTURE_SOURCE = "docs/paper.md, Capture in three dimensions: 15 grains"


@dataclass(frozen=True)
class Capture:
    """The largest random motions of which every grain was found again, from a zero start.

    Attributes
    ----------
    views : int
        Number of views of the study.
    ranges : tuple of (float, float)
        Every grain its own way up to so many grain diameters, and so many degrees.
    together : float
        The largest shift of the whole sample that was tried, and found again, in grain diameters.
    """

    views: int
    ranges: tuple[tuple[float, float], ...]
    together: float

    def __str__(self) -> str:
        return " or ".join(f"{d:g} diameter and {a:g}°" for d, a in self.ranges)


MEASURED_CAPTURES = (
    Capture(2, ((0.25, 30.0),), 3.0),
    Capture(3, ((0.5, 60.0),), 3.0),
    Capture(4, ((0.75, 30.0), (0.5, 60.0)), 3.0),
    Capture(6, ((0.75, 30.0), (0.5, 60.0)), 3.0),
)


def expected_capture(views: int) -> Capture:
    """What was measured with so many views, or with the next smaller number."""
    return max((c for c in MEASURED_CAPTURES if c.views <= views), key=lambda c: c.views)


def room(grains: GrainArrays, geometry: Geometry) -> NDArray[np.float64]:
    """How far the sample may move across and along the axis before a shadow leaves the panel, ``(2,)``, mm.

    The smallest distance of any grain's shadow from the panel's left and right edges, and from its lower and
    upper ones, over all views, carried back to the sample; 0 where a shadow is cut already, infinite along the
    axis of a planar sample.
    """
    points = (grains.hulls + grains.centers[:, None]).reshape(-1, 3)
    spots = geometry.project_points(points).reshape(-1, 2)
    panel = np.array(geometry.shape)
    free = np.minimum(spots + 0.5, panel - 0.5 - spots)
    margins = np.nan_to_num(free, nan=0.0).min(axis=0)
    row, column = np.maximum(margins, 0) * geometry.pixel_at(grains.centers.mean(axis=0))
    return np.array([column, np.inf if planar(grains, geometry) else row])
