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
from grainmotion.tracking.few_grains import MIN_GRAINS_IN_PARTS, freed, merged, placed_among
from grainmotion.tracking.multiresolution import FREE_GRAIN_PIXELS, coarsened, coarsening
from grainmotion.tracking.scene_target import target_of
from grainmotion.tracking.settings import TrackSettings
from grainmotion.tracking.unseen import unseen_pixels

FILTER_GRAIN_PIXELS = 45.0
"""Pixels across the grains on which the default filter widths were measured."""
INITIAL_STOPPING = Stopping(iterations=20, step=0.1, decrease=0.05)
"""For the stages that only bring all grains near."""
COARSE_STOPPING = Stopping(iterations=8, step=0.02, decrease=0.1, straggler_distance=1.0)
"""For stages that a narrower filter follows."""
LIT_SHARE = 0.05
"""Share of the largest line integral from which a pixel shows the sample."""
DECREASE_PER_UNKNOWN, DEFAULT_TOLERANCE = 3e-3, 2e-3
"""Decrease of the cost, over one unknown's share of it, that ends the last stage at the default tolerance (voxels); it
goes with the square of the tolerance."""
PAUSE_DECREASE, PAUSE_RESIDUAL = 0.01, 0.05
"""Share of the cost over several steps below which the last stage may pause, and the relative residual that it needs:
0.004 to 0.016 where all grains fit, 0.1 where some are lost."""
PAUSE_TRIALS_OF_MANY, STEPS_BEFORE_PAUSE_OF_MANY = 3, 3
"""Steps over which a stage of many grains compares its costs to pause, and steps before that.  Of 800 smooth ellipsoids
in 4 views, motions are off the truth by 0.0871 voxel and 6.1 degrees (median) there, and by 0.0859 voxel and 6.0
degrees after 35 more (decision 0056)."""
REST_VOXELS, MAX_FEW_SHARE, MAX_ROUNDS_OF_FEW = 0.025, 0.1, 3
"""Where no more than this share of many grains moves further than these voxels in a step of the last stage, while some
keep it from ending, those are solved for alone, the others fixed; so many times."""
MAX_COARSE_STRAGGLERS = 0.01
"""Share of many grains that may still move by a voxel when a stage that a narrower filter follows ends; there such a
stage ends with the first step that does not lower the cost, too."""
MAX_REJECTIONS = 2
"""Steps of many grains, one after the other, that do not lower the cost, after which the last stage ends."""
STRAGGLER_VOXELS, MAX_STRAGGLER_SHARE = 0.1, 1e-3
"""No decrease ends the last stage while more than this share of the grains moves further than these voxels; those
that still do are reported as moving."""


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
    saw in part, and ``given_valid`` the pixels that count but for those that see what it did not.
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

    def filtered_target(self, width: float, response_model: ResponseModel | None = None) -> Target:
        """The radiographs under a filter of ``width`` pixels, scaled to the grains but for widths below 1.

        ``response_model`` are the unknowns of the response, by default those of early stages (`while_far`).
        """
        sigma = max(width * self.filter_scale, 0.7) if width >= 1 else width
        return replace(
            self.target, sigma=sigma, response_model=response_model or self.settings.response_model.while_far
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

    def coarse_stopping(self, tolerance: float | None = None) -> Stopping:
        """Stopping criteria of a stage that a narrower filter follows."""
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        iterations = min(COARSE_STOPPING.iterations, self.settings.iterations)
        stopping = replace(COARSE_STOPPING, iterations=iterations, step=max(tolerance, COARSE_STOPPING.step))
        if len(self.grains) < MIN_GRAINS_IN_PARTS:
            return stopping
        return replace(stopping, stragglers=MAX_COARSE_STRAGGLERS, rejections=1, interpolate=True)

    def fine_stopping(self, tolerance: float | None = None) -> Stopping:
        """Stopping criteria of a last stage: no grain moves further than the tolerance, or all by little of their sd.

        ½‖r‖² over the number of pixels is the decrease by one unknown that moves by its standard deviation.
        """
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        share = min(6 * len(self.grains) / max(lit_pixels(self.target), 1), 1.0)
        decrease = DECREASE_PER_UNKNOWN * share * (tolerance / DEFAULT_TOLERANCE) ** 2
        many = len(self.grains) >= MIN_GRAINS_IN_PARTS
        return Stopping(
            self.settings.iterations, tolerance, decrease, STRAGGLER_VOXELS, MAX_STRAGGLER_SHARE, interpolate=many
        )

    def pausing(self, stopping: Stopping, target: Target) -> Stopping:
        """The criteria of a last stage that may end where it only creeps (decisions 0045 and 0056)."""
        largest = 0.5 * PAUSE_RESIDUAL**2 * dot(target.measured, target.measured)
        stopping = replace(stopping, pause=PAUSE_DECREASE, pause_cost=largest)
        if len(self.grains) < MIN_GRAINS_IN_PARTS:
            return stopping
        return replace(
            stopping, pause_trials=PAUSE_TRIALS_OF_MANY, pause_after=STEPS_BEFORE_PAUSE_OF_MANY, creeping=True
        )

    def held_stopping(self, target: Target) -> Stopping:
        """Stopping criteria with weak directions held: many grains, of which some always creep, may pause."""
        stopping = self.fine_stopping()
        if len(self.grains) < MIN_GRAINS_IN_PARTS:
            return stopping
        return replace(self.pausing(stopping, target), rejections=MAX_REJECTIONS)

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
        for width in filters[:-1]:
            stage_model = model.while_far if width == settings.filters[0] else model.without_hardening
            problem = StateProblem(*self.level(width, stage_model))
            observe = self.observer(problem.target, f"{name}, filter {width:g}")
            pose = gauss_newton(problem, pose, self.coarse_stopping(tolerance), observe).state
        width = filters[-1]
        problem = StateProblem(self.fine_grains, self.filtered_target(width, model))
        observe = self.observer(problem.target, f"{name}, filter {width:g}")
        stopping = self.fine_stopping(tolerance)
        if may_pause:
            stopping = self.pausing(stopping, problem.target)
        if len(self.grains) < MIN_GRAINS_IN_PARTS:
            return problem, gauss_newton(problem, pose, stopping, observe)
        return problem, self._solve_in_parts(problem, pose, stopping, observe)

    def _solve_in_parts(
        self, problem: StateProblem, pose: Pose, stopping: Stopping, observe: Callable[[float], None]
    ) -> Solution[Pose]:
        """The last stage of many grains: while only few of them move, these alone."""
        stopping = replace(stopping, rest=REST_VOXELS, few=MAX_FEW_SHARE, rejections=MAX_REJECTIONS)
        solution = gauss_newton(problem, pose, stopping, observe)
        for _ in range(MAX_ROUNDS_OF_FEW):
            if solution.moving is None:
                break
            rows = np.flatnonzero(solution.moving)
            part, some = freed(problem, solution.state, rows)
            end = gauss_newton(part, some, stopping_of_few(stopping, len(rows) / len(self.grains)), observe)
            solution = gauss_newton(problem, merged(solution.state, end.state, rows), stopping, observe)
        return solution

    def solve_few(
        self, pose: Pose, rows: NDArray[np.int64], name: str, tolerance: float
    ) -> tuple[StateProblem, Solution[Pose]]:
        """Only the grains of ``rows`` free, filter by filter, the others where they are; see `solve_free`."""
        settings, model, share = self.settings, self.settings.response_model, len(rows) / len(self.grains)
        for width in settings.filters[:-1]:
            stage_model = model.while_far if width == settings.filters[0] else model.without_hardening
            stopping = stopping_of_few(self.coarse_stopping(tolerance), share)
            part, some = freed(StateProblem(*self.level(width, stage_model)), pose, rows)
            observe = self.observer(part.target, f"{name}, filter {width:g}")
            pose = merged(pose, gauss_newton(part, some, stopping, observe).state, rows)
        width = settings.filters[-1]
        problem = StateProblem(self.fine_grains, self.filtered_target(width, model))
        part, some = freed(problem, pose, rows)
        observe = self.observer(part.target, f"{name}, filter {width:g}")
        stopping = stopping_of_few(self.fine_stopping(tolerance), share)
        return problem, placed_among(problem, pose, gauss_newton(part, some, stopping, observe), rows)


def stopping_of_few(stopping: Stopping, share: float) -> Stopping:
    """The stopping criteria of a stage of all grains, for this share of them: costs are still those of all."""
    decrease, stragglers = stopping.decrease * share, min(stopping.stragglers / share, 1.0)
    return replace(stopping, decrease=decrease, stragglers=stragglers, few=0.0, pause=0.0, rejections=np.inf)


def lit_pixels(target: Target) -> int:
    """Number of good pixels that show the sample."""
    images = np.abs(target.scan.line_integrals)
    return int(((images > LIT_SHARE * images.max(initial=0.0)) & (target.valid > 0)).sum())


def pixels_per_unknown(grains: GrainArrays, target: Target) -> float:
    """Good pixels that show the sample, over the number of unknowns."""
    return lit_pixels(target) / ((3 if planar(grains, target.scan.geometry) else 6) * len(grains))
