"""Misalignment: views that differ from the nominal geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix


@dataclass(frozen=True)
class Misalignment:
    """Difference of the true views from the nominal ones; see `misaligned`.

    Attributes
    ----------
    shift_pixels : (float, float)
        Shift of the panel along its u and v.
    turn_deg : float
        Rotation of the panel in its plane.
    stage_deg : float
        Excess rotation of the stage.

    Examples
    --------
    >>> gm.simulate.Misalignment(stage_deg=0.5).stage_deg
    0.5
    """

    shift_pixels: tuple[float, float] = (0.0, 0.0)
    turn_deg: float = 0.0
    stage_deg: float = 0.0


@checked_arguments
def misaligned(
    geometry: Geometry,
    *,
    shift_pixels: ArrayLike = (0.0, 0.0),
    turn_deg: ArrayLike = 0.0,
    stage_deg: ArrayLike = 0.0,
) -> Geometry:
    """The true views where the panel is shifted or rotated, or the stage rotated too far.

    Parameters
    ----------
    geometry : Geometry
        The nominal views.
    shift_pixels : (2,) or (views, 2) array_like
        Shift of the panel along its own u and v: features appear at lower columns and rows.
    turn_deg : float or (views,) array_like
        Rotation of the panel about its normal u × v through its shifted centre, right-hand rule.
    stage_deg : float or (views,) array_like
        Excess rotation of the stage: source and panel rotate about +z in the sample frame, as they do when an angle of
        `Geometry.cone` grows.

    Returns
    -------
    Geometry
        The true views.

    Raises
    ------
    InputError
        If there is neither one number nor one a view.

    Examples
    --------
    >>> views = case.scanner.geometry((0, 90))
    >>> true = gm.simulate.misaligned(views, shift_pixels=(1.0, 0.0))
    >>> np.allclose(true.detector - views.detector, views.u)
    True
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
    in_plane = rotation_matrix(np.deg2rad(turn)[:, None] * normals)
    u, v = (np.einsum("nij,nj->ni", in_plane, a) for a in (geometry.u, geometry.v))
    about_z = rotation_matrix(np.deg2rad(stage)[:, None] * np.array([0.0, 0.0, 1.0]))
    vectors = np.concatenate([np.einsum("nij,nj->ni", about_z, a) for a in (geometry.source, d, u, v)], axis=1)
    return Geometry(vectors, geometry.shape, geometry.beam)


def crept(geometry: Geometry, creep: ArrayLike) -> Geometry:
    """The true views of a scan in whose course the sample creeps at an even rate.

    A sample that moves by d is seen as a resting one by a scanner that moves by −d.

    Parameters
    ----------
    geometry : Geometry
        The views, in the order in which they were taken.
    creep : (3,) array_like
        Displacement of the sample from the first view to the last, mm; midway it is where the geometry has it.

    Returns
    -------
    Geometry
        The views that source and panel have with respect to the sample.
    """
    share = np.linspace(-0.5, 0.5, len(geometry))[:, None] if len(geometry) > 1 else np.zeros((1, 1))
    moved = share * np.asarray(creep, dtype=float)
    source = geometry.source - moved if geometry.beam == "cone" else geometry.source
    vectors = np.concatenate([source, geometry.detector - moved, geometry.u, geometry.v], axis=1)
    return Geometry(vectors, geometry.shape, geometry.beam)
