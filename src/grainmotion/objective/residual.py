"""The D-DPC residual of one state, and its normal equations, for the solver.

Eq. 22 of Khalili et al. (2017), weighted and filtered:  r = F w (b − m(P)), with P the line integrals of the
moved grains and the background, m the detector's response (gain, offset and more, see `freedom`), w the root
of each pixel's weight and F a Gaussian on each radiograph.  Derivatives are treated as the residual is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from grainmotion._typing import Float, Image
from grainmotion.backends.patchwork import filter_patches
from grainmotion.model.detector_response import Response
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import NuisanceMotion, Pose
from grainmotion.objective import nuisance_motions
from grainmotion.objective.data_term import Target
from grainmotion.objective.global_parameters import Columns, dot
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_of, spread
from grainmotion.objective.response_parameters import eliminated, powers
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import (
    Patches,
    assemble,
    difference_patches,
    differentiate_in_place,
    project_in_place,
    shadows,
)
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.solvers.gauss_newton import Linearization

Basis = Callable[[GrainArrays, Pose], Float]
"""From grains and pose to T ``(6n, m)``: the increments (u, δ) of all grains per unit of m parameters."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What one simulation at a pose yields, without derivatives.

    ``values`` are each grain's own line integrals, on the card if the grains are there and seen from the host all
    the same; ``residual`` and ``simulated`` are weighted and filtered, ``path`` (P) and ``raw`` (b − m(P), 0 where a
    pixel does not count) are not; ``linear`` are eliminated unknowns.
    """

    patches: Patches
    values: Any
    residual: Image
    simulated: Image
    path: Image
    raw: Image
    response: Response
    linear: Columns

    @property
    def cost(self) -> float:
        """½‖r‖²."""
        return 0.5 * dot(self.residual, self.residual)


@dataclass(frozen=True, eq=False)
class LinearizedEvaluation(Evaluation):
    """The same with ``derivatives`` of m(P) in the patches and by the ``loose`` surroundings, weighted and filtered."""

    derivatives: Any
    loose: Columns


@dataclass(frozen=True, eq=False)
class Prior:
    """Where the grains are expected: ``precisions (n, 6, 6)`` of (u, δ) from there, in units of the cost."""

    pose: Pose
    precisions: Float

    def departure(self, pose: Pose) -> Float:
        """(u, δ) of each grain from where it is expected, ``(n, 6)``."""
        turns = rotation_vector(pose.matrices @ np.swapaxes(self.pose.matrices, 1, 2))
        return np.hstack([pose.translations - self.pose.translations, turns])

    def pull(self, pose: Pose) -> Float:
        """Gradient of its share of the cost, ``(n, 6)``."""
        found: Float = np.einsum("nij,nj->ni", self.precisions, self.departure(pose))
        return found


@dataclass(frozen=True, eq=False)
class StateProblem:
    """The residual of one state, a `gauss_newton.Problem`; ``basis`` ties the grains' motions (None: all are free)."""

    grains: GrainArrays
    target: Target
    basis: Basis | None = None
    prior: Prior | None = None

    def look(self, pose: Pose) -> LinearizedEvaluation:
        """Simulate, compare and differentiate at a pose."""
        target = self.target
        geometry = self._geometry(pose)
        patches = self._patches(pose, geometry, margin=len(target.kernel) - 1)
        values, derivatives = self._differentiate(pose, geometry, patches)
        glance, stacks = self._compare(pose, geometry, patches, values)
        moving = self._moving(glance, pose, geometry, derivatives, stacks)
        factor = target.roots * glance.response.slope(glance.path)
        filter_patches(derivatives, patches.boxes, patches.offsets, factor, target.kernel)
        return LinearizedEvaluation(**vars(glance), derivatives=derivatives, loose=moving)

    def glance(self, pose: Pose) -> Evaluation:
        """Simulate and compare at a pose."""
        geometry = self._geometry(pose)
        patches = self._patches(pose, geometry)
        values = project_in_place(self.grains, pose, geometry, patches, self.target.projector)
        return self._compare(pose, geometry, patches, values)[0]

    def _geometry(self, pose: Pose) -> Geometry:
        return nuisance_motions.corrected(self.target.scan.geometry, pose.surroundings)

    def _patches(self, pose: Pose, geometry: Geometry, margin: int = 0) -> Patches:
        return shadows(self.grains, pose, geometry, margin)

    def _differentiate(self, pose: Pose, geometry: Geometry, patches: Patches) -> tuple[Any, Any]:
        """The grains' line integrals in their patches, and the derivatives of these, not yet filtered."""
        differentiate = differentiate_in_place if self.target.derivatives == "analytic" else difference_patches
        return differentiate(self.grains, pose, geometry, patches, self.target.projector)

    def _compare(self, pose: Pose, geometry: Geometry, patches: Patches, values: Any) -> tuple[Evaluation, list[Image]]:
        """What is left of the radiographs, and the derivatives by the background's motion if it is unknown."""
        target, loose = self.target, self.target.loose
        path, stacks = target.fixed, list[Image]()
        if target.body is not None and (loose.body or loose.views or pose.surroundings is not None):
            path, stacks = nuisance_motions.background_images(
                target.body, pose.surroundings, geometry, target.projector, loose.body or loose.views
            )
        path = assemble(values, patches, geometry) + path
        response, simulated, linear = self._respond(path)
        raw = (target.scan.line_integrals.astype(target.precision) - response.apply(path)) * target.valid
        return Evaluation(patches, values, target.measured - simulated, simulated, path, raw, response, linear), stacks

    def _moving(self, at: Evaluation, pose: Pose, geometry: Geometry, derivatives: Any, stacks: list[Image]) -> Columns:
        """Derivatives by the surroundings' unknowns, from the grains' own (not yet filtered) and the background's."""
        target, loose = self.target, self.target.loose
        slope = at.response.slope(at.path)
        moving = Columns()
        if loose.views:
            images = nuisance_motions.view_images(at.path, derivatives, self.grains, pose, at.patches)
            if target.body is not None:
                images[2] = images[2] + nuisance_motions.turned_background(target.body, pose.surroundings, stacks)
            for image in images:
                moving.add(target.filtered(slope * image), shared=False)
        for stack in stacks if loose.body else []:
            moving.add(target.filtered(slope * stack), shared=True)
        return moving

    def _respond(self, path: Image) -> tuple[Response, Image, Columns]:
        """The best response to the line integrals of the model, what it gives, and the columns eliminated.

        A polynomial that is not monotone is no response: its degree is lowered until it is, the gain fixed last.
        """
        target = self.target
        plain = target.filtered(path)
        freedom, views = target.freedom, len(path)
        while True:
            linear = Columns()
            for k, (power, shared) in enumerate(powers(freedom, path)):
                first = k == 0 and freedom.gain != "none"
                linear.add(plain if first else target.filtered(power), shared)
            linear = linear + target.trends
            response, more = eliminated(freedom, linear, target.measured - plain, views)
            if response.is_monotone(float(path.max(initial=0.0))) or (freedom.gain == "none" and freedom.degree == 1):
                return response, plain + more, linear
            lower = replace(freedom, degree=freedom.degree - 1)
            freedom = lower if freedom.degree > 1 else freedom.without_gain

    def cost(self, state: Pose) -> float:
        """½‖r‖² at a pose, with the priors' share."""
        return self.glance(state).cost + self._prior_cost(state)

    def linearize(self, state: Pose) -> Linearization:
        """Cost ½‖r‖², gradient and normal matrix at a pose, with the priors' share."""
        if self.basis is not None:
            return self._linearize_tied(state, self.basis(self.grains, state))
        seen, n = self.look(state), len(self.grains)
        columns = seen.linear + seen.loose
        hessian = normal_of(seen.derivatives, seen.patches, n, seen.residual.shape)
        both = (Columns([seen.residual], [True]) + columns).border(seen.derivatives, seen.patches, n)
        gradient, border, corner = -both[:, 0], np.ascontiguousarray(both[:, 1:]), columns.gram()
        slope = self._with_surroundings(state, corner, -seen.loose.dot(seen.residual))
        if self.prior is not None:
            gradient = gradient + self.prior.pull(state).ravel()
            hessian = raised(hessian, self.prior.precisions)
        return Linearization(seen.cost + self._prior_cost(state), gradient, hessian, border, corner, slope)

    def _linearize_tied(self, state: Pose, tie: Float) -> Linearization:
        """The same for the few parameters of ``tie`` ``(6n, m)``: an image each, so that few are filtered."""
        target, n, few = self.target, len(self.grains), tie.shape[1]
        geometry = self._geometry(state)
        patches = self._patches(state, geometry)
        values, derivatives = self._differentiate(state, geometry, patches)
        seen, stacks = self._compare(state, geometry, patches, values)
        slope = seen.response.slope(seen.path)
        tied = Columns()
        for image in spread(derivatives, patches, tie.T.reshape(few, n, 6), seen.path.shape):
            tied.add(target.filtered(slope * image), shared=True)
        loose = self._moving(seen, state, geometry, derivatives, stacks)
        gram = (tied + seen.linear + loose).gram()
        hessian, border, corner = gram[:few, :few], gram[:few, few:], gram[few:, few:]
        gradient = -tied.dot(seen.residual)
        stepping = self._with_surroundings(state, corner, -loose.dot(seen.residual))
        if self.prior is not None:
            gradient = gradient + tie.T @ self.prior.pull(state).ravel()
            held = np.einsum("nij,njm->nim", self.prior.precisions, tie.reshape(n, 6, few))
            hessian = hessian + tie.T @ held.reshape(6 * n, few)
        return Linearization(seen.cost + self._prior_cost(state), gradient, hessian, border, corner, stepping)

    def _with_surroundings(self, state: Pose, corner: Float, slope: Float) -> Float:
        """Count the prior on the surroundings in: in the corner's last rows, in place, and in the slope returned."""
        free = len(slope)
        if not free:
            return slope
        precisions, departure = self.surrounding_prior(state)
        corner[-free:, -free:] += precisions
        return slope + precisions @ departure

    def _prior_cost(self, state: Pose) -> float:
        """The priors' share of the cost."""
        cost = 0.0
        if self.target.loose.body or self.target.loose.views:
            precisions, departure = self.surrounding_prior(state)
            cost += 0.5 * float(departure @ precisions @ departure)
        if self.prior is not None:
            cost += 0.5 * float(np.vdot(self.prior.pull(state), self.prior.departure(state)))
        return cost

    def surrounding_prior(self, state: Pose) -> tuple[Float, Float]:
        """Precisions of the prior on the surroundings' unknowns, in units of the cost, and how far these are."""
        loose, views = self.target.loose, len(self.target.scan)
        at = state.surroundings or NuisanceMotion.still(views)
        return self.variance * loose.precisions(views), nuisance_motions.values(loose, at)

    @cached_property
    def variance(self) -> float:
        """What a pixel's residual is at least expected to be, squared; gives the surroundings' prior its unit."""
        return LEAST_SHARE**2 * float(np.mean(self.target.measured.astype(float) ** 2))

    def retract(self, state: Pose, step: Float) -> Pose:
        """Add translations; turn on the group, Ω ← exp[δ]ₓ Ω; move the surroundings."""
        each, rest = self._each(state, step)
        around = state.surroundings
        if len(rest):
            still = NuisanceMotion.still(len(self.target.scan))
            around = nuisance_motions.moved(self.target.loose, around or still, rest)
        return Pose(state.translations + each[:, :3], rotation_matrix(each[:, 3:]) @ state.matrices, around)

    def sizes(self, state: Pose, step: Float) -> Float:
        """Displacement of each grain's surface, in voxels ``(n,)``."""
        each, _ = self._each(state, step)
        moved = np.linalg.norm(each[:, :3], axis=1) + np.linalg.norm(each[:, 3:], axis=1) * self.grains.radii
        return np.asarray(moved / self.grains.unit)

    def _each(self, state: Pose, step: Float) -> tuple[Float, Float]:
        """Increments of the grains ``(n, 6)`` and of the surroundings.

        No grain alone goes further at once than its own diameter: one that is hardly seen would be flung away.
        """
        free = len(self.target.loose.deviations(len(self.target.scan)))
        own, rest = step[: len(step) - free], step[len(step) - free :]
        if self.basis is not None:
            return (self.basis(self.grains, state) @ own).reshape(-1, 6), rest
        each = own.reshape(-1, 6)
        far = np.linalg.norm(each[:, :3], axis=1) + np.linalg.norm(each[:, 3:], axis=1) * self.grains.radii
        return each * np.minimum(1.0, 2 * self.grains.radii / np.maximum(far, 1e-300))[:, None], rest


LEAST_SHARE = 0.01
"""Of the radiographs' rms: the residual that is expected at least, where nothing else says what to expect."""


def raised(hessian: sparse.bsr_array | PatchNormalMatrix, blocks: Float) -> sparse.bsr_array | PatchNormalMatrix:
    """H with 6×6 blocks added on its diagonal."""
    if isinstance(hessian, PatchNormalMatrix):
        return hessian.lifted(blocks)
    n = len(blocks)
    more = sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=hessian.shape)
    return sparse.bsr_array(hessian + more, blocksize=(6, 6))
