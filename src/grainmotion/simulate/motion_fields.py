"""Motions known exactly: none, rigid, random, affine, shear band."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions, Status
from grainmotion.rotations import apply_motion, rotation_matrix
from grainmotion.simulate.sample import Sample


def unmoved(sample: Sample) -> Motions:
    """No motion at all."""
    return _truth(sample, np.zeros((len(sample), 3)), np.zeros((len(sample), 3)))


def rigid(
    sample: Sample,
    translation: ArrayLike = (0.0, 0.0, 0.0),
    rotation_deg: ArrayLike = (0.0, 0.0, 0.0),
    center: ArrayLike = (0.0, 0.0, 0.0),
) -> Motions:
    """The whole sample moves as one body.

    Parameters
    ----------
    sample : Sample
    translation : (3,) array
        mm, after the rotation.
    rotation_deg : (3,) array
        Rotation vector, degrees.
    center : (3,) array
        Point that the rotation leaves in place, mm.
    """
    vector = np.deg2rad(np.asarray(rotation_deg, dtype=float))
    moved = apply_motion(rotation_matrix(vector), translation, center, sample.centers)
    return _truth(sample, moved - sample.centers, np.tile(vector, (len(sample), 1)))


def random(sample: Sample, max_translation: float, max_angle_deg: float, seed: int) -> Motions:
    """Every grain moves on its own: uniform in a ball of translations (mm), random axes, uniform angles.

    Parameters
    ----------
    sample : Sample
    max_translation : float
        Greatest *length* of a translation, mm.
    max_angle_deg : float
        Greatest angle, degrees.
    seed : int
    """
    if max_translation < 0 or not 0 <= max_angle_deg <= 180:
        raise InputError(
            "random motions",
            f"limits {max_translation} mm and {max_angle_deg}°",
            "give >= 0 mm and 0 to 180°",
        )
    rng = np.random.default_rng(seed)
    n = len(sample)
    translations = _directions(rng, n) * max_translation * np.cbrt(rng.uniform(size=(n, 1)))
    rotations = _directions(rng, n) * np.deg2rad(max_angle_deg) * rng.uniform(size=(n, 1))
    return _truth(sample, translations, rotations)


def affine(sample: Sample, gradient: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Motions:
    """A homogeneous strain: u = A (X − center), each grain rotating with the skew part of A.

    ``gradient`` is A = ∂u/∂X ``(3, 3)``, dimensionless.
    """
    a = np.asarray(gradient, dtype=float).reshape(3, 3)
    skew = (a - a.T) / 2
    rotation = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    return _truth(sample, (sample.centers - np.asarray(center, dtype=float)) @ a.T, np.tile(rotation, (len(sample), 1)))


def shear_band(
    sample: Sample,
    slip: float,
    thickness: float,
    *,
    normal: ArrayLike = (0.0, 0.5, 1.0),
    direction: ArrayLike = (0.0, 1.0, -0.5),
    center: ArrayLike = (0.0, 0.0, 0.0),
    rotation_factor: float = 1.0,
) -> Motions:
    """Two blocks slide past each other: u = ± slip/2 · tanh(2 s / thickness) along ``direction``.

    Parameters
    ----------
    sample : Sample
    slip : float
        Displacement of one block with respect to the other, mm.
    thickness : float
        Of the band, mm.
    normal, direction : (3,) array
        Of the band's plane and of the slip, which must lie in the plane; lengths do not matter.
    center : (3,) array
        A point of the band's mid-plane, mm.  s is the distance from it.
    rotation_factor : float
        Rotations of the grains over the continuum's, which is ½ curl u.
    """
    n, t = (np.asarray(v, dtype=float) / np.linalg.norm(np.asarray(v, dtype=float)) for v in (normal, direction))
    if abs(n @ t) > 1e-6 or not thickness > 0:
        raise InputError(
            "shear band",
            f"direction·normal = {n @ t:.3g}, thickness {thickness} mm",
            "slip in the plane, > 0 mm thick",
        )
    wave = np.tanh(2 * (sample.centers - np.asarray(center, dtype=float)) @ n / thickness)
    slope = slip / thickness * (1 - wave**2)  # du/ds
    rotations = rotation_factor * 0.5 * slope[:, None] * np.cross(n, t)
    return _truth(sample, 0.5 * slip * wave[:, None] * t, rotations)


def _truth(sample: Sample, translations: Float, rotations: Float) -> Motions:
    """Motions with the columns of a measurement: true centres, no uncertainty, all converged."""
    n = len(sample)
    start = Motions.identity(sample.labels, sample.centers)
    return dataclasses.replace(
        start,
        translations=translations,
        rotations=rotations,
        covariances=np.zeros((n, 6, 6)),
        statuses=np.full(n, Status.CONVERGED.value, dtype="<U20"),
        residuals=np.zeros(n),
    )


def _directions(rng: np.random.Generator, n: int) -> Float:
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)
