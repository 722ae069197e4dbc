"""Misalignment: views that are not quite what was written down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix


@dataclass(frozen=True)
class Slip:
    """How far the true views are from those written down; see `misaligned`.

    Attributes
    ----------
    shift_pixels : (float, float)
        Of the panel, along u and v.
    turn_deg : float
        Of the panel, in its plane.
    stage_deg : float
        By which the stage turned too far.
    """

    shift_pixels: tuple[float, float] = (0.0, 0.0)
    turn_deg: float = 0.0
    stage_deg: float = 0.0


def misaligned(
    geometry: Geometry,
    *,
    shift_pixels: ArrayLike = (0.0, 0.0),
    turn_deg: ArrayLike = 0.0,
    stage_deg: ArrayLike = 0.0,
) -> Geometry:
    """The views as they truly are, where the panel slipped or the stage turned too far.

    Parameters
    ----------
    geometry : Geometry
        What was written down.
    shift_pixels : (2,) or (views, 2) array
        Of the panel along its own u and v: features appear at lower columns and rows.
    turn_deg : float or (views,) array
        Of the panel about its normal u × v through its shifted centre, right-hand rule.
    stage_deg : float or (views,) array
        By which the stage turned too far: source and panel turn about +z in the sample frame, as a greater
        angle of `Geometry.cone` does.
    """
    n = len(geometry)
    try:
        shift = np.broadcast_to(np.asarray(shift_pixels, dtype=float), (n, 2))
        turn, stage = (np.broadcast_to(np.asarray(a, dtype=float), n) for a in (turn_deg, stage_deg))
    except ValueError:
        fact = f"{np.shape(shift_pixels)}, {np.shape(turn_deg)}, {np.shape(stage_deg)} do not fit {n} views"
        raise InputError("misalignment", fact, "give one number for all views, or one a view") from None
    d = geometry.detector + shift[:, :1] * geometry.u + shift[:, 1:] * geometry.v
    normals = geometry.normals / np.linalg.norm(geometry.normals, axis=1, keepdims=True)
    turns = rotation_matrix(np.deg2rad(turn)[:, None] * normals)
    u, v = (np.einsum("nij,nj->ni", turns, a) for a in (geometry.u, geometry.v))
    stages = rotation_matrix(np.deg2rad(stage)[:, None] * np.array([0.0, 0.0, 1.0]))
    vectors = np.concatenate([np.einsum("nij,nj->ni", stages, a) for a in (geometry.source, d, u, v)], axis=1)
    return Geometry(vectors, geometry.shape, geometry.beam)
