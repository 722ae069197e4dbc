"""What else may move: the background as one rigid body, and each view's pose.

Both are a few unknowns of the state as a whole.  Their derivative images join the border of the normal
equations (`gauss_newton.Linearization`), beside the linear unknowns of the response.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grainmotion._typing import Float, Image, Projector
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import NuisanceMotion, Pose
from grainmotion.objective.normal_matrix import spread
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import Patches, assemble, differentiate_patches, project_patches, shadows
from grainmotion.rotations import rotation_matrix, rotation_vector

VIEW = 3
"""Unknowns of a view's pose: shift of the panel along u and along v (pixels), angle of the stage (rad)."""


HELD = 1e6
"""Times the prior's information: what holds combinations of corrections that the sample's own motion imitates."""


@dataclass(frozen=True, eq=False)
class NuisanceModel:
    """What of the surroundings is unknown, and the prior's standard deviations, which fix what no view tells.

    Attributes
    ----------
    body : bool
        The background moves as one rigid body.
    views : bool
        Each view has a pose of its own.
    body_shift, body_turn : float
        mm, radians.
    view_shift, view_turn : float
        Pixels, radians.
    gauge : (unknowns, g) array, optional
        Combinations, orthonormal in units of the deviations, that are not free: the sample's own motion, of all
        grains as one body, does the same.
    """

    body: bool = False
    views: bool = False
    body_shift: float = 1.0
    body_turn: float = 0.1
    view_shift: float = 1.0
    view_turn: float = 0.01
    gauge: Float | None = None

    def deviations(self, views: int) -> Float:
        """Prior standard deviation of every unknown, in the order of the increments."""
        parts = []
        if self.views:
            parts.append(np.repeat([self.view_shift, self.view_shift, self.view_turn], views))
        if self.body:
            parts.append(np.repeat([self.body_shift, self.body_turn], 3))
        return np.concatenate(parts) if parts else np.zeros(0)

    def precisions(self, views: int) -> Float:
        """Of the prior ``(unknowns, unknowns)``, for a pixel's noise of variance 1."""
        inverse = 1 / self.deviations(views)
        out = np.eye(len(inverse))
        if self.gauge is not None:
            out += HELD * self.gauge @ self.gauge.T
        return out * np.outer(inverse, inverse)


STILL = NuisanceModel()
"""Nothing but the grains moves."""


def values(loose: NuisanceModel, at: NuisanceMotion) -> Float:
    """The unknowns at a pose, in the order of the increments; zero is where nothing has moved."""
    parts = []
    if loose.views:
        parts.append(at.views.T.ravel())
    if loose.body:
        parts += [at.translation, rotation_vector(at.matrix)]
    return np.concatenate(parts) if parts else np.zeros(0)


def moved(loose: NuisanceModel, at: NuisanceMotion, step: Float) -> NuisanceMotion:
    """The surroundings after an increment: shifts u, shifts v and angles of all views, then the body's (u, δ)."""
    views, translation, matrix = at.views, at.translation, at.matrix
    if loose.views:
        count = len(views)
        views = views + step[: VIEW * count].reshape(VIEW, count).T
        step = step[VIEW * count :]
    if loose.body:
        translation, matrix = translation + step[:3], rotation_matrix(step[3:6]) @ matrix
    return NuisanceMotion(views, translation, matrix)


def corrected(geometry: Geometry, at: NuisanceMotion | None) -> Geometry:
    """The views with their corrections: panels shifted by pixels along u and v, stage turned by an angle."""
    if at is None or not at.views.any():
        return geometry
    vectors = geometry.vectors.copy()
    vectors[:, 3:6] += at.views[:, :1] * geometry.u + at.views[:, 1:2] * geometry.v
    turns = rotation_matrix(at.views[:, 2:] * np.array([0.0, 0.0, 1.0]))
    blocks = np.einsum("vij,vkj->vki", turns, vectors.reshape(-1, 4, 3))
    return replace(geometry, vectors=blocks.reshape(-1, 12))


def view_images(path: Image, slopes: Any, grains: GrainArrays, pose: Pose, patches: Patches) -> list[Image]:
    """Derivatives of the line integrals ``(views, rows, columns)`` by each view's own shift u, v and angle.

    Shifts by central differences of the simulated radiograph; the angle, which turns the sample by as much the
    other way, from the grains' own derivatives (``slopes``, not yet filtered); a background's share is not in it
    (see `turned_background`).
    """
    along = np.gradient(path, axis=2) if path.shape[2] > 1 else np.zeros_like(path)
    up = np.gradient(path, axis=1) if path.shape[1] > 1 else np.zeros_like(path)
    places = grains.centers + pose.translations
    increments = np.zeros((1, len(places), 6))
    increments[0, :, 0], increments[0, :, 1], increments[0, :, 5] = places[:, 1], -places[:, 0], -1.0  # see `by_angle`
    return [along.astype(path.dtype), up.astype(path.dtype), *spread(slopes, patches, increments, path.shape)]


def turned_background(body: GrainArrays, at: NuisanceMotion | None, slopes: list[Image]) -> Image:
    """The background's share of the derivatives by the stage's angle, from its own by (u, δ)."""
    x, y, _ = body.centers[0] + (0 if at is None else at.translation)
    return by_angle(float(x), float(y), slopes)


def by_angle(x: Image | float, y: Image | float, slopes: Image | list[Image]) -> Image:
    """Derivative by the stage's angle of what lies at x, y: the sample turns by as much the other way."""
    return y * slopes[0] - x * slopes[1] - slopes[5]


def background_images(
    body: GrainArrays, at: NuisanceMotion | None, geometry: Geometry, projector: Projector, differentiate: bool
) -> tuple[Image, list[Image]]:
    """Line integrals of the background ``(views, rows, columns)``, and their derivatives by its (u, δ) if asked."""
    pose = Pose(np.zeros((1, 3)), np.eye(3)[None])
    if at is not None:
        pose = Pose(at.translation[None], at.matrix[None])
    patches = shadows(body, pose, geometry)
    if not differentiate:
        return assemble(project_patches(body, pose, geometry, patches, projector), patches, geometry), []
    line_integrals, slopes = differentiate_patches(body, pose, geometry, patches, projector)
    return assemble(line_integrals, patches, geometry), [assemble(s, patches, geometry) for s in slopes]
