"""Course: one state under way, from the widest filter to the narrowest."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from grainmotion._typing import Progress
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.global_parameters import dot
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.solvers.gauss_newton import Solution, Stopping, gauss_newton
from grainmotion.tracking.multiresolution import FREE_GRAIN_PIXELS, coarsened, coarsening
from grainmotion.tracking.settings import TrackSettings

FILTER_GRAIN_PIXELS = 45.0  # pixels across the grains on which the default filter widths were measured
INITIAL_STOPPING = Stopping(iterations=20, step=0.1, decrease=0.05)  # for the stages that only bring all grains near
COARSE_STOPPING = Stopping(
    iterations=8, step=0.02, decrease=0.1, straggler_distance=1.0, forcing=0.1
)  # where a narrower filter follows
LIT_SHARE = 0.05  # of the largest line integral: where something is seen
DECREASE_PER_UNKNOWN = (
    3e-3  # of the last stage: a decrease by so many times its share of the cost of each unknown is worth a step
)
STRAGGLER_VOXELS = 0.1  # voxels: while any grain moves further, no decrease is too small
MAX_STRAGGLER_SHARE = 1e-3  # share of the grains that are not waited for: they are told to be still moving
DEFAULT_TOLERANCE = 2e-3  # tolerance, voxels, to which that number belongs


@dataclass
class MultistageFit:
    """One state under way: what is fitted, the costs so far, and whom to tell.

    ``fine_grains`` are the same grains as ``grains`` on finer voxels, for the last stages; ``levels`` are coarser ones
    and their radiographs, by how much coarser.
    """

    settings: TrackSettings
    grains: GrainArrays
    fine_grains: GrainArrays
    target: Target
    progress: Progress | None
    costs: list[tuple[str, float]] = field(default_factory=list)
    stages_done: int = 0
    levels: dict[int, tuple[GrainArrays, Target]] = field(default_factory=dict)

    @property
    def expected_stages(self) -> int:
        """Stages to expect, a search's repetition not counted."""
        return len(self.settings.filters) + (3 if self.settings.fields else 0)

    @property
    def filter_scale(self) -> float:
        """Grain size over the one for which the filter widths are given."""
        across = 2 * float(np.median(self.grains.radii))
        pixels = across / self.target.scan.geometry.pixel_at(self.grains.centers.mean(axis=0))
        return float(np.clip(pixels / FILTER_GRAIN_PIXELS, 0.3, 4.0))

    def filtered_target(self, width: float, response_model: ResponseModel | None = None) -> Target:
        """The radiographs under a filter of ``width``, scaled to the grains but for widths below 1 pixel.

        ``response_model`` is what of the response is unknown; by default what is so while grains are far.
        """
        sigma = max(width * self.filter_scale, 0.7) if width >= 1 else width
        return replace(
            self.target, sigma=sigma, response_model=response_model or self.settings.response_model.while_far
        )

    def level(
        self, width: float, response_model: ResponseModel | None = None, least: float = FREE_GRAIN_PIXELS
    ) -> tuple[GrainArrays, Target]:
        """Grains and radiographs as coarse as a stage under a filter may see them, with that filter."""
        target = self.filtered_target(width, response_model)
        factor = coarsening(self.grains, target, target.sigma, least)
        if factor not in self.levels:
            grains = self.grains.coarsened(factor)
            if self.target.device.walks_coarse and factor > 1:
                grains = grains.on(self.target.device)
            self.levels[factor] = grains, coarsened(self.target, factor)
        grains, coarse = self.levels[factor]
        return grains, replace(coarse, sigma=target.sigma / factor, response_model=target.response_model)

    def report(self, message: str, done: int) -> None:
        """Report progress, if anybody listens."""
        if self.progress is not None:
            self.progress(message, min(done, self.expected_stages), self.expected_stages)

    def solve(self, problem: StateProblem, pose: Pose, stopping: Stopping, name: str) -> Solution[Pose]:
        """Solve a problem, keeping and telling the costs."""
        norm = dot(problem.target.measured, problem.target.measured) or 1.0

        def observe(cost: float) -> None:
            self.costs.append((name, float(np.sqrt(2 * cost / norm))))
            self.report(f"{name}: residual {self.costs[-1][1]:.4f}", self.stages_done)

        self.report(name, self.stages_done)
        solution = gauss_newton(problem, pose, stopping, observe)
        self.stages_done += 1
        return solution

    def coarse_stopping(self, tolerance: float | None = None) -> Stopping:
        """When a stage ends that a narrower filter follows."""
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        return replace(
            COARSE_STOPPING,
            iterations=min(COARSE_STOPPING.iterations, self.settings.iterations),
            step=max(tolerance, COARSE_STOPPING.step),
        )

    def fine_stopping(self, tolerance: float | None = None) -> Stopping:
        """When a last stage ends: no grain moves further than the tolerance, or all of them but little of their sd.

        ½‖r‖² over the pixels is what one unknown lowers it by if it moves by its standard deviation.
        """
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        share = min(6 * len(self.grains) / max(lit_pixels(self.target), 1), 1.0)
        worth = DECREASE_PER_UNKNOWN * share * (tolerance / DEFAULT_TOLERANCE) ** 2
        return Stopping(self.settings.iterations, tolerance, worth, STRAGGLER_VOXELS, MAX_STRAGGLER_SHARE)

    def solve_free(
        self, pose: Pose, name: str, filters: tuple[float, ...] | None = None, tolerance: float | None = None
    ) -> tuple[StateProblem, Solution[Pose]]:
        """All grains free, filter by filter; gain and offset join once the filter is narrow.

        ``filters`` and the ``tolerance`` (voxels) at which the last one ends are the settings' unless given.
        """
        settings = self.settings
        filters = settings.filters if filters is None else filters
        for k, width in enumerate(filters):
            last = k == len(filters) - 1
            response_model = settings.response_model
            if not last:
                response_model = (
                    response_model.while_far if width == settings.filters[0] else response_model.without_hardening
                )
            seen = (
                (self.fine_grains, self.filtered_target(width, response_model))
                if last
                else self.level(width, response_model)
            )
            problem = StateProblem(*seen)
            stopping = self.fine_stopping(tolerance) if last else self.coarse_stopping(tolerance)
            solution = self.solve(problem, pose, stopping, f"{name}, filter {width:g}")
            pose = solution.state
        return problem, solution


def lit_pixels(target: Target) -> int:
    """Good pixels on which something is seen."""
    images = np.abs(target.scan.line_integrals)
    return int(((images > LIT_SHARE * images.max(initial=0.0)) & (target.valid > 0)).sum())


def pixels_per_unknown(grains: GrainArrays, target: Target) -> float:
    """Good pixels on which something is seen, over the number of unknowns."""
    return lit_pixels(target) / ((3 if planar(grains, target.scan.geometry) else 6) * len(grains))
