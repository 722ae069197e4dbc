"""Candidate views: their angles, those nearest to them in a scan, and even sets among them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Beam, Float
from grainmotion.model.geometry import Geometry
from grainmotion.planning.settings import PlanSettings


def candidate_angles(beam: Beam, settings: PlanSettings) -> Float:
    """Angles to choose from, degrees: from 0 in steps of ``step_deg``, the end of the span left out.

    Opposite views of a parallel beam are mirror images, so its span is 180° by default.
    """
    span = settings.span_deg or (180.0 if beam == "parallel" else 360.0)
    return np.arange(0, span * (1 - 1e-9), settings.step_deg)


def angles_between(geometry: Geometry) -> Float:
    """Angles ``(m, m)`` between the views' central rays as lines, degrees: 0 for opposite views, 90 at most."""
    rays = geometry.rays / np.linalg.norm(geometry.rays, axis=1, keepdims=True)
    return np.rad2deg(np.arccos(np.clip(np.abs(rays @ rays.T), 0, 1)))


def nearest_views(geometry: Geometry, settings: PlanSettings) -> Geometry:
    """Of a scan's own views those nearest to the candidate angles, each once."""
    chosen = _nearest(geometry.azimuths_deg, candidate_angles(geometry.beam, settings), 360.0)
    return geometry[np.unique(chosen)]


def even_set(angles_deg: Float, count: int, first: int = 0) -> tuple[int, ...] | None:
    """The candidates nearest to ``count`` angles evenly over 180° from candidate ``first`` on; None if two coincide."""
    wanted = angles_deg[first] + np.arange(count) * 180.0 / count
    chosen = np.unique(_nearest(angles_deg, wanted, 360.0))
    return tuple(int(i) for i in chosen) if len(chosen) == count else None


def _nearest(angles_deg: Float, wanted_deg: Float, period: float) -> NDArray[np.int64]:
    apart = np.abs((angles_deg - wanted_deg[:, None] + period / 2) % period - period / 2)
    return np.argmin(apart, axis=1)
