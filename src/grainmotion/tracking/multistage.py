"""The multi-stage driver of one state: free motions of all grains, from the widest filter to the narrowest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Progress
from grainmotion.backends.base import PatchBackend
from grainmotion.backends.device import Device, backend_of
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking import stage_stopping
from grainmotion.tracking.expected_rotations import (
    RESIDUAL_WHILE_FAR,
    RESIDUAL_WHILE_NEAR,
    near_expected_rotations,
)
from grainmotion.tracking.few_grains import MIN_GRAINS_IN_PARTS, freed, merged, placed_among
from grainmotion.tracking.multiresolution import FREE_GRAIN_PIXELS, coarsened, coarsening
from grainmotion.tracking.scene_target import target_of
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.stage_stopping import MAX_REJECTIONS, MAX_ROUNDS_OF_FEW
from grainmotion.tracking.unseen import unseen_pixels

FILTER_GRAIN_PIXELS = 45.0
"""Pixels across the grains on which the default filter widths were measured."""
LIT_SHARE = 0.05
"""Share of the largest line integral from which a pixel shows the sample."""
MIN_FILTER_RATIO = 1.5
"""Least width of a filter of many grains over that of the last one, for a stage of its own."""
MAX_SOUGHT = 8
"""Grains that are sought at once where few fit badly, the worst of them: each takes 3 s, and disturbs others."""
STAGES_OF_JUDGING = 4
"""Stages that follow the fit, as progress counts them: weak directions, weights, other poses, statuses."""
USUAL_STEPS, REPORTED_PARTS = 4, 100
"""Steps after which half of a stage counts as done, how many more there will be is not known; parts of a stage."""


@dataclass
class MultistageFit:
    """The fit of one state under way.

    ``fine_grains`` are the same as ``grains`` on finer voxels, for the last stages; ``target`` is not yet filtered;
    ``costs`` hold the stage and the relative residual after each accepted step; ``levels`` are coarser grains and
    radiographs, by how many times coarser; ``seen`` is what the reference scan saw, ``cut (n,)`` are the grains that it
    saw in part, and ``given_valid`` the pixels that count but for those that see what it did not; ``expected`` is the
    pose near which rotations of many grains are kept at first (`expected_rotations`); ``most_sought`` are the grains
    that are sought at once where few fit badly.
    """

    settings: TrackSettings
    grains: GrainArrays
    fine_grains: GrainArrays
    target: Target
    progress: Progress | None
    costs: list[tuple[str, float]] = field(default_factory=list)
    stages_done: int = 0
    levels: dict[int, tuple[GrainArrays, Target]] = field(default_factory=dict)
    seen: FieldOfView | None = None
    given_valid: NDArray[np.bool_] | None = None
    cut: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    expected: Pose | None = None
    most_sought: int = MAX_SOUGHT

    @classmethod
    def of(
        cls,
        grains: GrainSet,
        scan: Scan,
        settings: TrackSettings,
        progress: Progress | None = None,
        device: Device | PatchBackend | None = None,
    ) -> MultistageFit:
        """Prepare the grains and the radiographs of a state for the kernels."""
        backend, smooth = backend_of(device or settings.device), settings.projector == "trilinear"
        coarse, fine = (GrainArrays.of(grains, fine=f and smooth).on(backend) for f in (False, True))
        target = target_of(grains, scan, settings, backend)
        return cls(
            settings, coarse, fine, target, progress, seen=grains.scene.field, given_valid=scan.valid, cut=grains.cut
        )

    @classmethod
    def coarse(
        cls, grains: GrainSet, scan: Scan, settings: TrackSettings, device: Device | PatchBackend | None = None
    ) -> MultistageFit:
        """The same without finer voxels, for a comparison of poses under a wide filter."""
        backend = backend_of(device or settings.device)
        arrays, target = GrainArrays.of(grains, fine=False).on(backend), target_of(grains, scan, settings, backend)
        return cls(
            settings, arrays, arrays, target, None, seen=grains.scene.field, given_valid=scan.valid, cut=grains.cut
        )

    @property
    def expected_stages(self) -> int:
        """Stages to expect before grains are judged, repetitions by the search not counted."""
        return len(self.settings.filters) + (3 if self.settings.fields else 0) + (2 if self.settings.strain else 0)

    def leave_out_unseen(self, pose: Pose) -> None:
        """Leave out the pixels that see, with the grains at a pose, what the reference scan did not."""
        if self.seen is None:
            return
        scan = self.target.scan
        unseen = unseen_pixels(self.seen, self.grains, pose, scan.geometry)
        if unseen is None:
            return
        valid = ~unseen if self.given_valid is None else self.given_valid & ~unseen
        self.target = replace(self.target, scan=replace(scan, valid=valid))
        self.levels = {f: (grains, coarsened(self.target, f)) for f, (grains, _) in self.levels.items()}

    @property
    def filter_scale(self) -> float:
        """Grain size over the one for which the filter widths are given."""
        across = 2 * float(np.median(self.grains.radii))
        pixels = across / self.target.scan.geometry.pixel_at(self.grains.centers.mean(axis=0))
        return float(np.clip(pixels / FILTER_GRAIN_PIXELS, 0.3, 4.0))

    def sigma_of(self, width: float) -> float:
        """The filter of a ``width`` for these grains, pixels."""
        return max(width * self.filter_scale, 0.7) if width >= 1 else width

    def filtered_target(self, width: float, response_model: ResponseModel | None = None) -> Target:
        """The radiographs under a filter of ``width`` pixels, scaled to the grains but for widths below 1.

        ``response_model`` are the unknowns of the response, by default those of early stages (`while_far`).
        """
        return replace(
            self.target,
            sigma=self.sigma_of(width),
            response_model=response_model or self.settings.response_model.while_far,
        )

    def level(
        self, width: float, response_model: ResponseModel | None = None, least: float = FREE_GRAIN_PIXELS
    ) -> tuple[GrainArrays, Target]:
        """Grains and filtered radiographs, as coarse as the filter allows with grains ``least`` pixels across."""
        target = self.filtered_target(width, response_model)
        factor = coarsening(self.grains, target, target.sigma, least)
        if factor not in self.levels:
            grains = self.grains.coarsened(factor)
            if self.target.backend.places_coarse_grains and factor > 1:
                grains = grains.on(self.target.backend)
            self.levels[factor] = grains, coarsened(self.target, factor)
        grains, coarse = self.levels[factor]
        return grains, replace(coarse, sigma=target.sigma / factor, response_model=target.response_model)

    def report(self, message: str, done: float) -> None:
        """Report progress, in stages; more of them than expected share the last one, infinitely many are all."""
        if self.progress is not None:
            most = self.expected_stages + STAGES_OF_JUDGING
            done = done if done <= most - 1 else most - 1 / (2 + done - most)
            self.progress(message, int(REPORTED_PARTS * done), REPORTED_PARTS * most)

    def observer(self, target: Target, name: str) -> Callable[[float], None]:
        """Begin a stage, and return the callback that records and reports each cost under the stage's name."""
        norm, stage = dot(target.measured, target.measured) or 1.0, self.stages_done
        steps = 0

        def observe(cost: float) -> None:
            nonlocal steps
            steps += 1
            self.costs.append((name, float(np.sqrt(2 * cost / norm))))
            self.report(f"{name}: residual {self.costs[-1][1]:.4f}", stage + steps / (steps + USUAL_STEPS))

        self.report(name, stage)
        self.stages_done += 1
        return observe

    @property
    def many(self) -> bool:
        """Whether there are so many grains that their normal matrix is a product only."""
        return len(self.grains) >= MIN_GRAINS_IN_PARTS

    def coarse_stopping(self, tolerance: float | None = None) -> Stopping:
        """Stopping criteria of a stage that a narrower filter follows."""
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        return stage_stopping.of_coarse_stage(self.settings.iterations, tolerance, self.many)

    def fine_stopping(self, tolerance: float | None = None) -> Stopping:
        """Stopping criteria of a last stage."""
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        unknowns_per_pixel = 6 * len(self.grains) / max(lit_pixels(self.target), 1)
        return stage_stopping.of_last_stage(self.settings.iterations, tolerance, unknowns_per_pixel, self.many)

    def pausing(self, stopping: Stopping, target: Target) -> Stopping:
        """The criteria of a last stage that may end where it only creeps."""
        return stage_stopping.pausing(stopping, dot(target.measured, target.measured), self.many)

    def held_stopping(self, target: Target, again: bool = False) -> Stopping:
        """Stopping criteria once all grains are near: many, of which some always creep, may pause.

        ``again`` is after some of them moved to another pose.
        """
        stopping = self.fine_stopping()
        if not self.many:
            return stopping
        stopping = replace(self.pausing(stopping, target), rejections=MAX_REJECTIONS)
        return stage_stopping.again(stopping) if again else stopping

    def solve_free(
        self,
        pose: Pose,
        name: str,
        filters: tuple[float, ...] | None = None,
        tolerance: float | None = None,
        may_pause: bool = False,
    ) -> tuple[StateProblem, Solution[Pose]]:
        """All grains free, filter by filter; gain and offset join once the filter is narrow.

        ``filters`` and the ``tolerance`` (voxels) at which the last one ends are the settings' by default.  It
        ``may_pause`` where all grains fit and only directions are left that the views hardly determine (decision 0045).
        """
        settings, model = self.settings, self.settings.response_model
        filters = settings.filters if filters is None else filters
        if may_pause and self.expected is not None:  # the last stage begins on coarser voxels, as the one before would
            least = MIN_FILTER_RATIO * self.sigma_of(filters[-1])
            filters = (*(width for width in filters[:-1] if self.sigma_of(width) >= least), filters[-1])
        for width in filters[:-1]:
            stage_model = model.while_far if width == settings.filters[0] else model.without_hardening
            problem = StateProblem(*self.level(width, stage_model))
            if may_pause:
                problem = self.near_expected(problem, RESIDUAL_WHILE_FAR)
            observe = self.observer(problem.target, f"{name}, filter {width:g}")
            pose = gauss_newton(problem, pose, self.coarse_stopping(tolerance), observe).state
        width = filters[-1]
        problem = StateProblem(self.fine_grains, self.filtered_target(width, model))
        observe = self.observer(problem.target, f"{name}, filter {width:g}")
        stopping = self.fine_stopping(tolerance)
        if may_pause:
            stopping = self.pausing(stopping, problem.target)
        if may_pause and self.expected is not None:
            near = self.near_expected(replace(problem, grains=self.grains), RESIDUAL_WHILE_NEAR)
            first = gauss_newton(near, pose, stage_stopping.of_first_steps(stopping), observe)
            if first.paused and not problem.target.nuisance.moving_bodies:
                return problem, first
            pose = first.state
        if not self.many:
            return problem, gauss_newton(problem, pose, stopping, observe)
        return problem, self._solve_in_parts(problem, pose, stopping, observe)

    def near_expected(self, problem: StateProblem, residual: float) -> StateProblem:
        """A problem with rotations kept near expected ones, if there are any; see `near_expected_rotations`."""
        return problem if self.expected is None else near_expected_rotations(problem, self.expected, residual)

    def _solve_in_parts(
        self, problem: StateProblem, pose: Pose, stopping: Stopping, observe: Callable[[float], None]
    ) -> Solution[Pose]:
        """The last stage of many grains: while only few of them move, these alone."""
        stopping = stage_stopping.in_parts(stopping)
        solution = gauss_newton(problem, pose, stopping, observe)
        for _ in range(MAX_ROUNDS_OF_FEW):
            if solution.moving is None:
                break
            rows = np.flatnonzero(solution.moving)
            part, some = freed(problem, solution.state, rows)
            end = gauss_newton(part, some, stage_stopping.of_few(stopping, len(rows) / len(self.grains)), observe)
            solution = gauss_newton(problem, merged(solution.state, end.state, rows), stopping, observe)
        return solution

    def solve_few(
        self, pose: Pose, rows: NDArray[np.int64], name: str, tolerance: float
    ) -> tuple[StateProblem, Solution[Pose]]:
        """Only the grains of ``rows`` free, filter by filter, the others where they are; see `solve_free`."""
        settings, model, share = self.settings, self.settings.response_model, len(rows) / len(self.grains)
        for width in settings.filters[:-1]:
            stage_model = model.while_far if width == settings.filters[0] else model.without_hardening
            stopping = stage_stopping.of_few(self.coarse_stopping(tolerance), share)
            part, some = freed(StateProblem(*self.level(width, stage_model)), pose, rows)
            observe = self.observer(part.target, f"{name}, filter {width:g}")
            pose = merged(pose, gauss_newton(part, some, stopping, observe).state, rows)
        width = settings.filters[-1]
        problem = StateProblem(self.fine_grains, self.filtered_target(width, model))
        part, some = freed(problem, pose, rows)
        observe = self.observer(part.target, f"{name}, filter {width:g}")
        stopping = stage_stopping.of_few(self.fine_stopping(tolerance), share)
        return problem, placed_among(problem, pose, gauss_newton(part, some, stopping, observe), rows)


def lit_pixels(target: Target) -> int:
    """Number of good pixels that show the sample."""
    images = np.abs(target.scan.line_integrals)
    return int(((images > LIT_SHARE * images.max(initial=0.0)) & (target.valid > 0)).sum())


def pixels_per_unknown(grains: GrainArrays, target: Target) -> float:
    """Good pixels that show the sample, over the number of unknowns."""
    return lit_pixels(target) / ((3 if planar(grains, target.scan.geometry) else 6) * len(grains))
