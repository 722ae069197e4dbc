"""Pixels of a state that see what the reference scan did not.

Where the sample goes on above or below the field of the reference, nothing is known of its attenuation there.  It
moves with its neighbours, so that the border of what is known is the border of the field moved by the smooth part of
the grains' motions.  Pixels whose rays pass beyond it are left out before any filter, so that wide filters carry
nothing across it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays

MIN_UNSEEN_MARGIN, UNSEEN_SPREAD = 2.0, 1.5
"""Width that is left out beside the moved border of the field, voxels, and over the standard deviation of the grains'
heights about their smooth displacement; the larger counts."""
MIN_GRAINS_FOR_AFFINE = 8
"""Grains from which the smooth displacement is affine; that of fewer is their mean."""
RINGS, SPOKES = 5, 24
"""Rings and points on each at which the border is followed."""
MAX_UNSEEN_SHARE = 0.5
"""Share of a view's rows beyond which a border is not left out: too little would be left to register the grains."""


def unseen_pixels(field: FieldOfView, grains: GrainArrays, pose: Pose, geometry: Geometry) -> NDArray[np.bool_] | None:
    """Pixels ``(views, rows, columns)`` whose rays pass beyond borders at which the sample goes on; None if none do."""
    if not (field.above or field.below):
        return None
    places = _places(field)
    displacement, spread = _smooth_displacement(grains, pose)
    margin = max(MIN_UNSEEN_MARGIN * grains.unit, UNSEEN_SPREAD * spread)
    mask = np.zeros((len(geometry), *geometry.shape), dtype=bool)
    for heights, upwards in zip(field.border_heights(places), (-1, 1), strict=True):
        if np.isfinite(heights).all():
            border = np.c_[places, heights]
            border += displacement(border)
            border[:, 2] -= upwards * margin
            mask |= _beyond(border, upwards * grains.unit, geometry, field.radius)
    return mask if mask.any() else None


def _places(field: FieldOfView) -> Float:
    """Points (x, y) of the sample's outline and within it."""
    radii = field.radius * np.arange(1, RINGS + 1) / RINGS
    angles = 2 * np.pi * np.arange(SPOKES) / SPOKES
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.asarray(np.vstack([np.zeros((1, 2)), (radii[:, None, None] * ring).reshape(-1, 2)]) + field.axis)


def _smooth_displacement(grains: GrainArrays, pose: Pose) -> tuple[Callable[[Float], Float], float]:
    """The affine displacement of points (m, 3) that fits the grains' best, and the sd of their heights about it, mm."""
    centers, u = grains.centers, pose.translations
    middle = centers.mean(axis=0)
    terms = np.ones((len(centers), 1))
    affine = len(centers) >= MIN_GRAINS_FOR_AFFINE
    if affine:
        terms = np.c_[terms, centers - middle]
    weights = np.ones(len(centers))
    for _ in range(5):  # a few misplaced grains do not count
        coefficients = np.linalg.lstsq(terms * weights[:, None], u * weights[:, None], rcond=None)[0]
        off = np.linalg.norm(u - terms @ coefficients, axis=1)
        weights = 1 / np.sqrt(1 + (off / max(2 * float(np.median(off)), 1e-9 * grains.unit)) ** 2)

    def displacement(points: Float) -> Float:
        ones = np.ones((len(points), 1))
        return np.asarray((np.c_[ones, points - middle] if affine else ones) @ coefficients)

    residual = np.abs(u - terms @ coefficients)[:, 2]
    return displacement, 1.4826 * float(np.median(residual))


def _beyond(border: Float, step: float, geometry: Geometry, radius: float) -> NDArray[np.bool_]:
    """Pixels beyond the projection of a border, in the direction in which a point that rises by ``step`` goes."""
    pixels = geometry.project_points(np.concatenate([border, border + np.array([0, 0, step])])).reshape(
        len(geometry), 2, len(border), 2
    )
    rows, columns = np.arange(geometry.shape[0]), np.arange(geometry.shape[1])
    near = 0.3 * radius / geometry.pixel_at(border.mean(axis=0))
    mask = np.zeros((len(geometry), *geometry.shape), dtype=bool)
    for view, ((low, column), (high, _)) in enumerate(np.moveaxis(pixels, -1, -2)):
        rises = np.sign(high - low)
        if not np.isfinite(low).all() or abs(rises.sum()) < len(rises):  # no view from the side
            continue
        beside = np.abs(columns[:, None] - column) < near
        edge = np.where(beside, rises[0] * low, np.inf).min(axis=1)  # the first border that a column meets
        mask[view] = rises[0] * rows[:, None] > edge
        if mask[view].mean() > MAX_UNSEEN_SHARE:
            mask[view] = False
    return mask
