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
from grainmotion.tracking.multiresolution import ALONE, coarsened, coarsening
from grainmotion.tracking.settings import TrackSettings

GRAIN = 45.0  # pixels across the grains on which the default filter widths were measured
ROUGHLY = Stopping(iterations=20, step=0.1, decrease=0.05)  # for the stages that only bring all grains near
NEAR = Stopping(iterations=8, step=0.02, decrease=0.1, reach=1.0, forcing=0.1)  # where a narrower filter follows
SEEN = 0.05  # of the largest line integral: where something is seen
WORTH = 3e-3  # of the last stage: a decrease by so many times its share of the cost of each unknown is worth a step
REACH = 0.1  # voxels: while any grain moves further, no decrease is too small
STRAGGLERS = 1e-3  # share of the grains that are not waited for: they are told to be still moving
DEFAULT = 2e-3  # tolerance, voxels, to which that number belongs


@dataclass
class MultistageFit:
    """One state under way: what is fitted, the costs so far, and whom to tell.

    ``fine`` are the same grains as ``grains`` on finer voxels, for the last stages; ``levels`` are coarser ones and
    their radiographs, by how much coarser.
    """

    settings: TrackSettings
    grains: GrainArrays
    fine: GrainArrays
    target: Target
    progress: Progress | None
    costs: list[tuple[str, float]] = field(default_factory=list)
    stage: int = 0
    levels: dict[int, tuple[GrainArrays, Target]] = field(default_factory=dict)

    @property
    def stages(self) -> int:
        """Stages to expect, a search's repetition not counted."""
        return len(self.settings.filters) + (3 if self.settings.fields else 0)

    @property
    def scale(self) -> float:
        """Grain size over the one for which the filter widths are given."""
        across = 2 * float(np.median(self.grains.radii))
        pixels = across / self.target.scan.geometry.pixel_at(self.grains.centers.mean(axis=0))
        return float(np.clip(pixels / GRAIN, 0.3, 4.0))

    def filter(self, width: float, freedom: ResponseModel | None = None) -> Target:
        """The radiographs under a filter of ``width``, scaled to the grains but for widths below 1 pixel.

        ``freedom`` is what of the response is unknown; by default what is so while grains are far.
        """
        sigma = max(width * self.scale, 0.7) if width >= 1 else width
        return replace(self.target, sigma=sigma, freedom=freedom or self.settings.freedom.at_first)

    def level(
        self, width: float, freedom: ResponseModel | None = None, least: float = ALONE
    ) -> tuple[GrainArrays, Target]:
        """Grains and radiographs as coarse as a stage under a filter may see them, with that filter."""
        target = self.filter(width, freedom)
        factor = coarsening(self.grains, target, target.sigma, least)
        if factor not in self.levels:
            grains = self.grains.coarsened(factor)
            if self.target.device.walks_coarse and factor > 1:
                grains = grains.on(self.target.device)
            self.levels[factor] = grains, coarsened(self.target, factor)
        grains, coarse = self.levels[factor]
        return grains, replace(coarse, sigma=target.sigma / factor, freedom=target.freedom)

    def tell(self, message: str, done: int) -> None:
        """Report progress, if anybody listens."""
        if self.progress is not None:
            self.progress(message, min(done, self.stages), self.stages)

    def solve(self, problem: StateProblem, pose: Pose, stopping: Stopping, name: str) -> Solution[Pose]:
        """Solve a problem, keeping and telling the costs."""
        norm = dot(problem.target.measured, problem.target.measured) or 1.0

        def observe(cost: float) -> None:
            self.costs.append((name, float(np.sqrt(2 * cost / norm))))
            self.tell(f"{name}: residual {self.costs[-1][1]:.4f}", self.stage)

        self.tell(name, self.stage)
        solution = gauss_newton(problem, pose, stopping, observe)
        self.stage += 1
        return solution

    def rough(self, tolerance: float | None = None) -> Stopping:
        """When a stage ends that a narrower filter follows."""
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        return replace(NEAR, iterations=min(NEAR.iterations, self.settings.iterations), step=max(tolerance, NEAR.step))

    def fine_stopping(self, tolerance: float | None = None) -> Stopping:
        """When a last stage ends: no grain moves further than the tolerance, or all of them but little of their sd.

        ½‖r‖² over the pixels is what one unknown lowers it by if it moves by its standard deviation.
        """
        tolerance = self.settings.tolerance if tolerance is None else tolerance
        share = min(6 * len(self.grains) / max(lit_pixels(self.target), 1), 1.0)
        worth = WORTH * share * (tolerance / DEFAULT) ** 2
        return Stopping(self.settings.iterations, tolerance, worth, REACH, STRAGGLERS)

    def free(
        self, pose: Pose, name: str, filters: tuple[float, ...] | None = None, tolerance: float | None = None
    ) -> tuple[StateProblem, Solution[Pose]]:
        """All grains free, filter by filter; gain and offset join once the filter is narrow.

        ``filters`` and the ``tolerance`` (voxels) at which the last one ends are the settings' unless given.
        """
        settings = self.settings
        filters = settings.filters if filters is None else filters
        for k, width in enumerate(filters):
            last = k == len(filters) - 1
            freedom = settings.freedom
            if not last:
                freedom = freedom.at_first if width == settings.filters[0] else freedom.midway
            seen = (self.fine, self.filter(width, freedom)) if last else self.level(width, freedom)
            problem = StateProblem(*seen)
            stopping = self.fine_stopping(tolerance) if last else self.rough(tolerance)
            solution = self.solve(problem, pose, stopping, f"{name}, filter {width:g}")
            pose = solution.state
        return problem, solution


def lit_pixels(target: Target) -> int:
    """Good pixels on which something is seen."""
    images = np.abs(target.scan.line_integrals)
    return int(((images > SEEN * images.max(initial=0.0)) & (target.valid > 0)).sum())


def pixels_an_unknown(grains: GrainArrays, target: Target) -> float:
    """Good pixels on which something is seen, over the number of unknowns."""
    return lit_pixels(target) / ((3 if planar(grains, target.scan.geometry) else 6) * len(grains))
