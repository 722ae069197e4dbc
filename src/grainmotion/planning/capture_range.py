"""Capture range: the motions from which tracking was measured to recover, and the free margin on the detector.

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
    """The largest random motions that were measured correctly for every grain, from a zero start.

    Attributes
    ----------
    views : int
        Number of views of the study.
    ranges : tuple of (float, float)
        Every grain its own way up to so many grain diameters, and so many degrees.
    together : float
        The largest shift of the whole sample that was tried, and measured correctly, in grain diameters.
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
    """The capture range measured with so many views, or with the next smaller number."""
    return max((c for c in MEASURED_CAPTURES if c.views <= views), key=lambda c: c.views)


def room(grains: GrainArrays, geometry: Geometry) -> NDArray[np.float64]:
    """How far the sample may move across and along the axis before a projection leaves the detector, ``(2,)``, mm.

    The smallest distance of any grain's footprint from the detector's left and right edges, and from its lower and
    upper ones, over all views, scaled to the sample; 0 where a footprint is cut already, infinite along the axis of a
    planar sample.
    """
    points = (grains.hulls + grains.centers[:, None]).reshape(-1, 3)
    pixels = geometry.project_points(points).reshape(-1, 2)
    free = np.minimum(pixels + 0.5, np.array(geometry.shape) - 0.5 - pixels)
    margins = np.nan_to_num(free, nan=0.0).min(axis=0)
    row, column = np.maximum(margins, 0) * geometry.pixel_at(grains.centers.mean(axis=0))
    return np.array([column, np.inf if planar(grains, geometry) else row])
