"""Nuisance motions: those of bodies beside the grains, and a correction of each view's pose.

Both are a few unknowns of the state as a whole.  Their derivative images join the border of the normal
equations (`gauss_newton.Linearization`), beside the linear unknowns of the response.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float, Image, Projector
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import NuisanceMotion, Pose, ViewCorrections
from grainmotion.model.scene import Freedom
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import body_image, differentiated_body
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
    freedoms : tuple of Freedom
        How each body may move.
    views : bool
        Each view has a pose of its own.
    body_shift_sd, body_rotation_sd : float
        mm, radians.
    view_shift_sd_pixels, view_angle_sd : float
        Pixels, radians.
    gauge : (unknowns, g) array, optional
        Combinations, orthonormal in units of the deviations, that are fixed, because a motion of all grains as one
        body does the same.
    """

    freedoms: tuple[Freedom, ...] = ()
    views: bool = False
    body_shift_sd: float = 1.0
    body_rotation_sd: float = 0.1
    view_shift_sd_pixels: float = 1.0
    view_angle_sd: float = 0.01
    gauge: Float | None = None

    def deviations(self, views: int) -> Float:
        """Prior standard deviation of every unknown, in the order of the increments."""
        parts = []
        if self.views:
            parts.append(np.repeat([self.view_shift_sd_pixels, self.view_shift_sd_pixels, self.view_angle_sd], views))
        units = np.repeat([self.body_shift_sd, self.body_rotation_sd], 3)[:, None]
        parts += [1 / np.linalg.norm(freedom.basis / units, axis=0) for freedom in self.freedoms if freedom.moves]
        return np.concatenate(parts) if parts else np.zeros(0)

    @property
    def moving_bodies(self) -> list[int]:
        """Bodies that may move."""
        return [k for k, freedom in enumerate(self.freedoms) if freedom.moves]

    @property
    def body_unknowns(self) -> int:
        """Unknowns of all bodies."""
        return sum(len(freedom.ways) for freedom in self.freedoms)

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
    for k in nuisance.moving_bodies:
        motion = np.concatenate([at.translations[k], rotation_vector(at.matrices[k])])
        parts.append(np.linalg.pinv(nuisance.freedoms[k].basis) @ motion)
    return np.concatenate(parts) if parts else np.zeros(0)


def retract(nuisance: NuisanceModel, at: NuisanceMotion, step: Float) -> NuisanceMotion:
    """The motion after an increment: shifts u, shifts v and angles of all views, then the ways of each body."""
    views, translations, matrices = at.views, at.translations.copy(), at.matrices.copy()
    if nuisance.views:
        count = len(views.angles)
        increments = step[: UNKNOWNS_PER_VIEW * count].reshape(UNKNOWNS_PER_VIEW, count).T
        views = ViewCorrections.of(views.columns + increments)
        step = step[UNKNOWNS_PER_VIEW * count :]
    for k in nuisance.moving_bodies:
        basis = nuisance.freedoms[k].basis
        increment = basis @ step[: basis.shape[1]]
        translations[k] += increment[:3]
        matrices[k] = rotation_matrix(increment[3:]) @ matrices[k]
        step = step[basis.shape[1] :]
    return NuisanceMotion(views, translations, matrices)


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
    own ``jacobian`` by (u, δ), not yet filtered; that of bodies is `derivative_by_view_angle`.
    """
    along = np.gradient(path, axis=2) if path.shape[2] > 1 else np.zeros_like(path)
    up = np.gradient(path, axis=1) if path.shape[1] > 1 else np.zeros_like(path)
    places = grains.centers + pose.translations
    increments = np.zeros((1, len(places), 6))
    # as in `derivative_by_view_angle`
    increments[0, :, 0], increments[0, :, 1], increments[0, :, 5] = places[:, 1], -places[:, 0], -1.0
    return [along.astype(path.dtype), up.astype(path.dtype), *jacobian.images(increments)]


def derivative_by_view_angle(x: Image | float, y: Image | float, derivatives: Image | list[Image]) -> Image:
    """Derivative by the stage's angle of an object at x, y: it is as if the sample rotated the opposite way."""
    return y * derivatives[0] - x * derivatives[1] - derivatives[5]


@dataclass(frozen=True, eq=False)
class BodyImages:
    """Line integrals of all bodies ``(views, rows, columns)``, and of each that was differentiated its derivatives.

    ``derivatives`` hold the body's row, its x and y (mm) and six images by its (u, δ).
    """

    path: Image
    derivatives: tuple[tuple[int, float, float, list[Image]], ...] = ()


def body_images(
    bodies: tuple[GrainArrays, ...],
    nuisance: NuisanceModel,
    at: NuisanceMotion | None,
    views: tuple[Geometry, Projector],
    fixed: Image,
) -> BodyImages:
    """Images of the bodies where they are, differentiated if they may move or if the views may.

    ``views`` are the geometry as it is corrected and the projector.  ``fixed (views, rows, columns)`` are the images
    of bodies that may not move, which hold while no view is corrected.
    """
    geometry, projector = views
    everything = nuisance.views or (at is not None and bool(at.views.columns.any()))
    rows = range(len(bodies)) if everything else nuisance.moving_bodies
    motion = at if at is not None and len(at.translations) else NuisanceMotion.still(len(geometry), len(bodies))
    path = np.zeros_like(fixed) if everything and bodies else fixed.copy()
    derivatives = []
    for k in rows:
        place = motion.translations[k], motion.matrices[k]
        if nuisance.views or k in nuisance.moving_bodies:
            image, by_motion = differentiated_body(bodies[k], *place, geometry, projector)
            x, y, _ = bodies[k].centers[0] + motion.translations[k]
            derivatives.append((k, float(x), float(y), by_motion))
        else:
            image = body_image(bodies[k], *place, geometry, projector)
        path += image
    return BodyImages(path, tuple(derivatives))
