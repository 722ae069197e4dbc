"""The fit of a large sample of which some grains are left out, and of those around them anew."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion._typing import Float, Image
from grainmotion.model.pose import Pose
from grainmotion.objective.nuisance_motions import GRAINS_ONLY
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.attempt import Approach, Job
from grainmotion.tracking.ellipsoids import Ellipsoid
from grainmotion.tracking.ellipsoids_beside import shadow_discount
from grainmotion.tracking.few_grains import with_neighbours
from grainmotion.tracking.global_search import ATTEMPT_TOLERANCE
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.presence import count
from grainmotion.uncertainty.goodness_of_fit import Misfits, misfits

MAX_WHOLE_SHARE = 0.5
"""Share of the grains to be solved for anew from which all are."""
EXPECTED_NEIGHBOURS = 12
"""Nearest grains whose median translation a grain that is left out is expected to have."""
AMPLITUDE_FILTER = 6.0
"""Width of the filter, as in `TrackSettings`, under which amplitudes of grains that are left out are taken."""


@dataclass
class CrowdFit:
    """A large sample under way.

    ``pose`` is of all grains of the sample, ``out (n,)`` are those that are left out; ``fit`` and ``problem`` are of
    the others, beside images of what else was found; ``changed`` tells whether anything was.
    """

    sample: Job
    near: Approach
    fit: MultistageFit
    problem: StateProblem
    pose: Pose
    out: NDArray[np.bool_]
    changed: bool = False
    ellipsoids: list[Ellipsoid] = field(default_factory=list)

    @classmethod
    def of(cls, sample: Job, near: Approach) -> CrowdFit:
        """Before anything is left out."""
        nothing = np.zeros(len(sample.grains), dtype=bool)
        return cls(sample, near, near.fit, near.problem, near.solution.state, nothing)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Grains that are not left out."""
        return np.flatnonzero(~self.out)

    @property
    def own_pose(self) -> Pose:
        """The pose of these."""
        return some(self.pose, self.rows)

    @property
    def job(self) -> Job:
        """The job of these."""
        return replace(self.sample, grains=self.sample.grains.without(np.flatnonzero(self.out).tolist()))

    @property
    def diameter(self) -> float:
        """Median, mm."""
        return 2 * float(np.median(self.near.fit.grains.radii))

    @property
    def places(self) -> Float:
        """Centres of all grains at their poses ``(n, 3)``, mm."""
        return self.near.fit.grains.centers + self.pose.translations

    def misfits(self) -> tuple[Misfits, NDArray[np.bool_]]:
        """Misfits of the grains that are not left out, and which of all ``(n,)`` fit badly."""
        evaluation = self.problem.evaluate(self.own_pose)
        fits = misfits(self.problem, evaluation)
        bad = np.zeros(len(self.out), dtype=bool)
        bad[self.rows] = fits.misregistered & ~self.fit.cut & evaluation.patches.seen.any(axis=1)
        return fits, bad

    # ------------------------------------------------------------------ solving
    def around(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The grains ``(n,)`` that are ``chosen (n,)``, and those next to them."""
        near = np.zeros(len(self.out), dtype=bool)
        whole = replace(self.near.problem, grains=self.near.fit.grains)
        near[with_neighbours(whole, self.pose, np.flatnonzero(chosen))] = True
        return near

    def leave_out(self, out: NDArray[np.bool_]) -> None:
        """Leave these grains ``(n,)`` out, and no others."""
        self.out = out
        fit, stay = self.near.fit, self.rows
        backend, expected = fit.target.backend, fit.expected
        grains, fine = (each.select(stay).on(backend) for each in (fit.grains, fit.fine_grains))
        self.fit = replace(
            self.fit, grains=grains, fine_grains=fine, levels={}, cut=fit.cut[stay],
            expected=None if expected is None else some(expected, stay),
        )  # fmt: skip
        self._renew_problem()

    def _renew_problem(self) -> None:
        target = self.fit.filtered_target(self.fit.settings.filters[-1], self.near.problem.target.response_model)
        self.problem = StateProblem(self.fit.fine_grains, target)

    def solve(self, affected: NDArray[np.bool_], name: str) -> None:
        """Solve for the ``affected (n,)`` grains that are not left out, filter by filter."""
        chosen, fit = np.flatnonzero(affected[self.rows]), self.fit
        if not len(chosen):
            return
        tolerance = max(ATTEMPT_TOLERANCE, fit.settings.tolerance)
        if len(chosen) > MAX_WHOLE_SHARE * len(self.rows):
            self.problem, solution = fit.solve_free(self.own_pose, name, fit.settings.filters, tolerance)
        else:
            self.problem, solution = fit.solve_few(self.own_pose, chosen, name, tolerance)
        self.take(self.rows, solution.state)

    def solve_all(self) -> Solution[Pose]:
        """Solve for all grains under the last filter, from where they are."""
        settings, paused = self.fit.settings, self.near.solution.paused
        self.problem, solution = self.fit.solve_free(self.own_pose, "all", settings.filters[-1:], may_pause=paused)
        self.take(self.rows, solution.state)
        return solution

    def take(self, rows: NDArray[np.int64], pose: Pose) -> None:
        """Put some grains, of the ``rows (m,)`` of the sample, to a pose of theirs."""
        translations, matrices = self.pose.translations.copy(), self.pose.matrices.copy()
        translations[rows], matrices[rows] = pose.translations, pose.matrices
        nuisance = self.pose.nuisance if pose.nuisance is None else pose.nuisance
        self.pose = Pose(translations, matrices, nuisance)

    # ------------------------------------------------------------------ what else is there
    def add(self, image: Image | None, found: tuple[Ellipsoid, ...]) -> None:
        """Line integrals of new grains and of pieces beside the grains ``(views, rows, columns)``."""
        self.ellipsoids += found
        if image is not None:
            fixed = self.fit.target.fixed_background + image
            self.fit = replace(self.fit, target=replace(self.fit.target, fixed_background=fixed), levels={})
            self._renew_problem()

    def discount_ellipsoids(self) -> None:
        """Count shadows of new grains less: what ellipsoids leave of them is no misfit of the grains behind."""
        if self.ellipsoids:
            target = replace(self.problem.target, discount=None)
            evaluation = replace(self.problem, target=target).evaluate(self.own_pose)
            discount = shadow_discount(target, evaluation, self.ellipsoids)
            self.fit = replace(self.fit, target=replace(self.fit.target, discount=discount), levels={})
            self._renew_problem()

    def expected_pose(self, rows: NDArray[np.int64]) -> Pose:
        """Where grains of ``rows`` that are left out are expected by their neighbours."""
        centers, stay = self.near.fit.grains.centers, self.rows
        number = min(EXPECTED_NEIGHBOURS, len(stay))
        near = np.asarray(cKDTree(centers[stay]).query(centers[rows], number)[1]).reshape(len(rows), number)
        moved = np.median(self.pose.translations[stay][near], axis=1)
        return Pose(moved, self.near.field_pose.matrices[rows])

    def amplitudes(self, rows: NDArray[np.int64], pose: Pose) -> Float:
        """How much of the shadows of grains of ``rows``, which are left out, the others leave over, over their own."""
        evaluation = self.problem.evaluate(self.own_pose)
        path = evaluation.line_integrals
        target = replace(
            self.fit.filtered_target(AMPLITUDE_FILTER), fixed_background=path, bodies=(), nuisance=GRAINS_ONLY,
            discount=None, scan=replace(self.fit.target.scan, line_integrals=path + evaluation.left_path),
        )  # fmt: skip
        return count(self.near.fit.grains.select(rows).on(target.backend), target, pose).amplitudes


def some(pose: Pose, rows: NDArray[np.int64]) -> Pose:
    """The pose of some of its grains."""
    return pose.moved(pose.translations[rows], pose.matrices[rows])
