"""Nuisance motions: that of the background as one rigid body, and a correction of each view's pose.

Both are a few unknowns of the state as a whole.  Their derivative images join the border of the normal
equations (`gauss_newton.Linearization`), beside the linear unknowns of the response.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float, Image, Projector
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import NuisanceMotion, Pose, ViewCorrections
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_patches, project_patches
from grainmotion.projection.jacobian import PatchJacobian
from grainmotion.rotations import rotation_matrix, rotation_vector

UNKNOWNS_PER_VIEW = 3
"""Shift of the detector along u and along v (pixels), angle of the stage (radians)."""

GAUGE_PRECISION = 1e6
"""Precision, over the prior's, that fixes the combinations of corrections that the sample's own motion imitates."""


@dataclass(frozen=True, eq=False)
class NuisanceModel:
    """Which nuisance motions are unknown, and the standard deviations of the prior on them.

    The prior fixes what the views do not determine.

    Attributes
    ----------
    background : bool
        The background moves as one rigid body.
    views : bool
        Each view has a pose of its own.
    background_shift_sd, background_rotation_sd : float
        mm, radians.
    view_shift_sd_pixels, view_angle_sd : float
        Pixels, radians.
    gauge : (unknowns, g) array, optional
        Combinations, orthonormal in units of the deviations, that are fixed, because a motion of all grains as one
        body does the same.
    """

    background: bool = False
    views: bool = False
    background_shift_sd: float = 1.0
    background_rotation_sd: float = 0.1
    view_shift_sd_pixels: float = 1.0
    view_angle_sd: float = 0.01
    gauge: Float | None = None

    def deviations(self, views: int) -> Float:
        """Prior standard deviation of every unknown, in the order of the increments."""
        parts = []
        if self.views:
            parts.append(np.repeat([self.view_shift_sd_pixels, self.view_shift_sd_pixels, self.view_angle_sd], views))
        if self.background:
            parts.append(np.repeat([self.background_shift_sd, self.background_rotation_sd], 3))
        return np.concatenate(parts) if parts else np.zeros(0)

    def precisions(self, views: int) -> Float:
        """Inverse covariance ``(unknowns, unknowns)`` of the prior, for a pixel's noise of variance 1."""
        inverse = 1 / self.deviations(views)
        out = np.eye(len(inverse))
        if self.gauge is not None:
            out += GAUGE_PRECISION * self.gauge @ self.gauge.T
        return out * np.outer(inverse, inverse)


GRAINS_ONLY = NuisanceModel()
"""Nothing but the grains moves."""


def nuisance_values(nuisance: NuisanceModel, at: NuisanceMotion) -> Float:
    """The unknowns of a motion, in the order of the increments; zero where nothing has moved."""
    parts = []
    if nuisance.views:
        parts.append(at.views.columns.T.ravel())
    if nuisance.background:
        parts += [at.translation, rotation_vector(at.matrix)]
    return np.concatenate(parts) if parts else np.zeros(0)


def retract(nuisance: NuisanceModel, at: NuisanceMotion, step: Float) -> NuisanceMotion:
    """The motion after an increment: shifts u, shifts v and angles of all views, then the background's (u, δ)."""
    views, translation, matrix = at.views, at.translation, at.matrix
    if nuisance.views:
        count = len(views.angles)
        increments = step[: UNKNOWNS_PER_VIEW * count].reshape(UNKNOWNS_PER_VIEW, count).T
        views = ViewCorrections.of(views.columns + increments)
        step = step[UNKNOWNS_PER_VIEW * count :]
    if nuisance.background:
        translation, matrix = translation + step[:3], rotation_matrix(step[3:6]) @ matrix
    return NuisanceMotion(views, translation, matrix)


def corrected_geometry(geometry: Geometry, at: NuisanceMotion | None) -> Geometry:
    """The views with their corrections: panels shifted by pixels along u and v, stage rotated."""
    if at is None or not at.views.columns.any():
        return geometry
    shifts = at.views.shifts_pixels
    vectors = geometry.vectors.copy()
    vectors[:, 3:6] += shifts[:, :1] * geometry.u + shifts[:, 1:] * geometry.v
    rotations = rotation_matrix(at.views.angles[:, None] * np.array([0.0, 0.0, 1.0]))
    blocks = np.einsum("vij,vkj->vki", rotations, vectors.reshape(-1, 4, 3))
    return replace(geometry, vectors=blocks.reshape(-1, 12))


def view_derivatives(path: Image, jacobian: PatchJacobian, grains: GrainArrays, pose: Pose) -> list[Image]:
    """Derivatives of the line integrals ``(views, rows, columns)`` by each view's own shift u, shift v and angle.

    Those by shifts are central differences of the simulated radiograph.  That by the angle comes from the grains'
    own ``jacobian`` by (u, δ), not yet filtered; the background's share is added by `background_by_view_angle`.
    """
    along = np.gradient(path, axis=2) if path.shape[2] > 1 else np.zeros_like(path)
    up = np.gradient(path, axis=1) if path.shape[1] > 1 else np.zeros_like(path)
    places = grains.centers + pose.translations
    increments = np.zeros((1, len(places), 6))
    # as in `derivative_by_view_angle`
    increments[0, :, 0], increments[0, :, 1], increments[0, :, 5] = places[:, 1], -places[:, 0], -1.0
    return [along.astype(path.dtype), up.astype(path.dtype), *jacobian.images(increments)]


def background_by_view_angle(background: GrainArrays, at: NuisanceMotion | None, derivatives: list[Image]) -> Image:
    """The background's share of the derivatives by the stage's angle, from its own ``derivatives`` by (u, δ)."""
    x, y, _ = background.centers[0] + (0 if at is None else at.translation)
    return derivative_by_view_angle(float(x), float(y), derivatives)


def derivative_by_view_angle(x: Image | float, y: Image | float, derivatives: Image | list[Image]) -> Image:
    """Derivative by the stage's angle of an object at x, y: it is as if the sample rotated the opposite way."""
    return y * derivatives[0] - x * derivatives[1] - derivatives[5]


def background_images(
    background: GrainArrays, at: NuisanceMotion | None, geometry: Geometry, projector: Projector, differentiate: bool
) -> tuple[Image, list[Image]]:
    """Line integrals of the background ``(views, rows, columns)``, and their derivatives by its (u, δ) if asked."""
    at = at or NuisanceMotion.still(len(geometry))
    pose = Pose(at.translation[None], at.matrix[None])
    patches = footprint_patches(background, pose, geometry)
    if not differentiate:
        return assemble(project_patches(background, pose, geometry, patches, projector), patches, geometry), []
    values, derivatives = differentiate_patches(background, pose, geometry, patches, projector)
    return assemble(values, patches, geometry), [assemble(d, patches, geometry) for d in derivatives]
