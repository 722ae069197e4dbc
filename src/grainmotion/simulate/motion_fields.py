"""Prescribed motions: none, rigid, random, affine, shear band."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions, Status
from grainmotion.rotations import apply_motion, rotation_matrix
from grainmotion.simulate.sample import Sample


@checked_arguments
def unmoved(sample: Sample) -> Motions:
    """No motion.

    Parameters
    ----------
    sample : Sample
        In the reference state.

    Returns
    -------
    Motions
        Zero translations and rotations.

    Examples
    --------
    >>> float(np.abs(gm.simulate.unmoved(case.sample).translations).max())
    0.0
    """
    return _truth(sample, np.zeros((len(sample), 3)), np.zeros((len(sample), 3)))


@checked_arguments
def rigid(
    sample: Sample,
    translation: ArrayLike = (0.0, 0.0, 0.0),
    rotation_deg: ArrayLike = (0.0, 0.0, 0.0),
    center: ArrayLike = (0.0, 0.0, 0.0),
) -> Motions:
    """The whole sample moves as one rigid body.

    Parameters
    ----------
    sample : Sample
        In the reference state.
    translation, center : (3,) array_like
        Translation after the rotation, and fixed point of the rotation, mm.
    rotation_deg : (3,) array_like
        Rotation vector, degrees.

    Returns
    -------
    Motions
        The exact motions of the particles.

    Examples
    --------
    >>> truth = gm.simulate.rigid(case.sample, (0.4, -0.5, 0.7))
    >>> truth.translations[0].tolist()
    [0.4, -0.5, 0.7]
    """
    vector = np.deg2rad(np.asarray(rotation_deg, dtype=float))
    moved = apply_motion(rotation_matrix(vector), translation, center, sample.centers)
    return _truth(sample, moved - sample.centers, np.tile(vector, (len(sample), 1)))


@checked_arguments
def random(sample: Sample, max_translation: float, max_angle_deg: float, seed: int) -> Motions:
    """Independent random motions: translations uniform in a ball, axes of rotation random, angles uniform.

    Parameters
    ----------
    sample : Sample
        In the reference state.
    max_translation : float
        Greatest length of a translation, mm.
    max_angle_deg : float
        Greatest angle, degrees.
    seed : int
        The same seed gives the same motions.

    Returns
    -------
    Motions
        The exact motions of the particles.

    Raises
    ------
    InputError
        If a limit is negative, or the angle exceeds 180°.

    Examples
    --------
    >>> truth = gm.simulate.random(case.sample, 0.5, 10.0, seed=1)
    >>> bool(np.linalg.norm(truth.translations, axis=1).max() <= 0.5)
    True
    """
    if max_translation < 0 or not 0 <= max_angle_deg <= 180:
        fact = f"limits {max_translation} mm and {max_angle_deg}°"
        raise InputError("random motions", fact, "give >= 0 mm and 0 to 180°")
    rng = np.random.default_rng(seed)
    n = len(sample)
    translations = _directions(rng, n) * max_translation * np.cbrt(rng.uniform(size=(n, 1)))
    rotations = _directions(rng, n) * np.deg2rad(max_angle_deg) * rng.uniform(size=(n, 1))
    return _truth(sample, translations, rotations)


@checked_arguments
def affine(sample: Sample, gradient: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Motions:
    """Homogeneous deformation: u = A (X − center), each grain rotates by the axial vector of A's skew part.

    Parameters
    ----------
    sample : Sample
        In the reference state.
    gradient : (3, 3) array_like
        A = ∂u/∂X, dimensionless.
    center : (3,) array_like
        Point without displacement, mm.

    Returns
    -------
    Motions
        The exact motions of the particles.

    Raises
    ------
    InputError
        If the gradient is not 3 × 3 finite numbers.

    Examples
    --------
    >>> squeeze = gm.simulate.affine(case.sample, np.diag([0.0, 0.0, -0.02]))
    >>> np.allclose(squeeze.translations[:, 2], -0.02 * squeeze.centers[:, 2])
    True
    """
    a = np.asarray(gradient, dtype=float)
    if a.shape != (3, 3) or not np.isfinite(a).all():
        raise InputError("affine motions", f"a gradient of shape {a.shape}", "give 3 × 3 finite numbers, ∂u/∂X")
    skew = (a - a.T) / 2
    rotation = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    return _truth(sample, (sample.centers - np.asarray(center, dtype=float)) @ a.T, np.tile(rotation, (len(sample), 1)))


@checked_arguments
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
    """Two blocks slide past each other: u = slip/2 · tanh(2 s / thickness) along ``direction``.

    Parameters
    ----------
    sample : Sample
        In the reference state.
    slip : float
        Displacement of one block with respect to the other, mm.
    thickness : float
        Thickness of the band, mm.
    normal, direction : (3,) array_like
        Normal of the band's plane, and direction of the slip in it; of any length.
    center : (3,) array_like
        A point of the band's mid-plane, mm; s is the signed distance from that plane.
    rotation_factor : float
        Rotation of the grains over the continuum's, which is ½ curl u.

    Returns
    -------
    Motions
        The exact motions of the particles.

    Raises
    ------
    InputError
        If the slip is not in the band's plane, or the thickness is not positive.

    Examples
    --------
    >>> truth = gm.simulate.shear_band(case.sample, slip=0.4, thickness=1.0)
    >>> bool(np.linalg.norm(truth.translations, axis=1).max() <= 0.2)
    True
    """
    n, t = (np.asarray(v, dtype=float) / np.linalg.norm(np.asarray(v, dtype=float)) for v in (normal, direction))
    if abs(n @ t) > 1e-6 or not thickness > 0:
        fact = f"direction·normal = {n @ t:.3g}, thickness {thickness} mm"
        raise InputError("shear band", fact, "slip in the plane, > 0 mm thick")
    profile = np.tanh(2 * (sample.centers - np.asarray(center, dtype=float)) @ n / thickness)
    gradient = slip / thickness * (1 - profile**2)  # du/ds
    rotations = rotation_factor * 0.5 * gradient[:, None] * np.cross(n, t)
    return _truth(sample, 0.5 * slip * profile[:, None] * t, rotations)


def _truth(sample: Sample, translations: Float, rotations: Float) -> Motions:
    """Exact motions in the form of a measurement: true centres, zero covariance, all converged."""
    n = len(sample)
    return dataclasses.replace(
        Motions.identity(sample.labels, sample.centers),
        translations=translations,
        rotations=rotations,
        covariances=np.zeros((n, 6, 6)),
        statuses=np.full(n, Status.CONVERGED.value, dtype="<U20"),
        residuals=np.zeros(n),
    )


def _directions(rng: np.random.Generator, n: int) -> Float:
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)
