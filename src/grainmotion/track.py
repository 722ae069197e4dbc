"""D-DPC: the motion of every grain from a few radiographs (Khalili et al. 2017), in stages.

From the given start: (1) all grains as one body, from the start and from the shift that the
radiographs' centroids tell; (2) a smooth displacement field; (3) all grains free, under Gaussian
filters of falling width; (4) grains that still fit badly are searched over rotations, one by one with
their neighbours held, then all are free again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass as record
from dataclasses import field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from grainmotion.grains import GrainSet
from grainmotion.motions import Motions
from grainmotion.project import PackedGrains, Pose, Projector, project
from grainmotion.scan import Scan
from grainmotion.solve import Solution, Stopping, gauss_newton
from grainmotion.tracking import stages
from grainmotion.tracking.absent import complete, improves, merit, support, suspects
from grainmotion.tracking.judge import judge
from grainmotion.tracking.residual import Basis, Derivatives, StateProblem, Target
from grainmotion.tracking.search import lost_grains, search_lost
from grainmotion.tracking.starts import centroid_shift, starting_pose

Float = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

ROUGHLY = Stopping(iterations=20, step=0.1, decrease=1e-3)  # for the stages that only bring all grains near
TOO_MANY = 0.1  # share of badly fitting grains from which another start is tried
GRAIN = 45.0  # pixels across the grains on which the default filter widths were measured


@dataclass(frozen=True)
class TrackSettings:
    """How to track."""

    projector: Annotated[
        Projector, Field(description="operator; in an experiment file the reconstruction's own unless given")
    ] = "trilinear"
    derivatives: Annotated[Derivatives, Field(description="exact ones, or finite differences as in the paper")] = (
        "analytic"
    )
    filters: Annotated[
        tuple[float, ...],
        Field(
            min_length=1,
            description="Gaussian widths of the free stages in turn, pixels, for grains 45 pixels across",
        ),
    ] = (6.0, 2.0, 0.7)
    field_filter: Annotated[float, Field(ge=0, description="the same for the stages of one body and smooth field")] = (
        12.0
    )
    fields: Annotated[
        bool, Field(description="begin with one body and a smooth field; off: all grains free at once")
    ] = True
    search: Annotated[
        bool, Field(description="search rotations for grains that fit badly, leave out grains that are not there")
    ] = True
    gain: Annotated[bool, Field(description="eliminate a global gain and offset (a, b of Eq. 22)")] = True
    iterations: Annotated[int, Field(ge=1, description="most iterations a stage")] = 30
    tolerance: Annotated[
        float, Field(gt=0, description="a stage ends once no grain's surface moves further, voxels")
    ] = 2e-3
    max_sd_voxel: Annotated[
        float, Field(gt=0, description="a grain is poorly determined above this sd of u, voxels")
    ] = 0.5
    max_sd_deg: Annotated[
        float, Field(gt=0, description="a grain is poorly determined above this sd of ω, degrees")
    ] = 5.0


PAPER = TrackSettings(
    projector="exact",
    derivatives="differences",
    filters=(0.0,),
    fields=False,
    search=False,
    gain=False,
    iterations=200,
)
"""The variant of Khalili et al. (2017): Siddon's path, finite differences, no filter, no stages."""


@record
class Course:
    """One state under way: what is fitted, the costs so far, and whom to tell."""

    settings: TrackSettings
    grains: PackedGrains
    target: Target
    progress: Progress | None
    costs: list[tuple[str, float]] = field(default_factory=list)
    stage: int = 0

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

    def filter(self, width: float, gain: bool = False) -> Target:
        """The radiographs under a filter of ``width``, scaled to the grains but for widths below 1 pixel."""
        sigma = max(width * self.scale, 0.7) if width >= 1 else width
        return replace(self.target, sigma=sigma, gain=gain)

    def tell(self, message: str, done: int) -> None:
        """Report progress, if anybody listens."""
        if self.progress is not None:
            self.progress(message, min(done, self.stages), self.stages)


def track(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None = None,
    settings: TrackSettings | None = None,
    progress: Progress | None = None,
) -> Motions:
    """Measure the rigid motion of every grain from the reference state to the state of ``scan``.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state.
    scan : Scan
        A few radiographs of the later state, as line integrals.
    start : Motions, optional
        Motions to start from, as of the state before; none is no motion.  Grains in it without a
        finite motion start as the others moved on average.
    settings : TrackSettings, optional
        Stages, filters, projector.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Motions
        One row a grain; what became of it is in ``statuses`` and ``reasons``, never an exception.
    """
    settings = settings or TrackSettings()
    whole, supports = _all_together(grains, scan, start, settings, progress)
    best, present = whole, grains
    while settings.search and (absent := suspects(best, supports)):
        trials = [present.without(rows) for rows in absent]
        ends = [_all_together(t, scan, start, settings, progress) for t in trials]
        k = max(range(len(ends)), key=lambda k: merit(ends[k][0]))
        if not improves(ends[k][0], best):
            break
        present, (best, supports) = trials[k], ends[k]
    return complete(best, grains) if best.ok.sum() > whole.ok.sum() else whole


def _all_together(
    grains: GrainSet, scan: Scan, start: Motions | None, settings: TrackSettings, progress: Progress | None
) -> tuple[Motions, Float]:
    """All stages for some grains, and how much of each grain's shadow the radiographs hold."""
    packed = PackedGrains.of(grains)
    fixed = np.zeros(scan.line_integrals.shape, np.float32)
    if grains.background is not None:
        fixed = project(grains.background, scan.geometry, settings.projector)
    target = Target(scan, fixed, settings.projector, sigma=0.0, gain=False, derivatives=settings.derivatives)
    course = Course(settings, packed, target, progress)
    pose = _approach(course, starting_pose(grains, start))
    problem, solution = _free(course, pose, "free")
    if settings.search:
        found = search_lost(problem, solution.state, course.filter(settings.filters[0]))
        if found is not None:
            problem, solution = _free(course, found, "again")
    course.tell("judging the grains", course.stages)
    limits = (settings.max_sd_voxel * grains.voxel_size, float(np.deg2rad(settings.max_sd_deg)))
    motions = judge(grains, problem, solution, limits, tuple(course.costs))
    return motions, support(problem, solution.state)


def _approach(course: Course, pose: Pose) -> Pose:
    """The pose from which the free stages start well.

    A smooth field that carries the sample far can mislead grains that moved little and each its own way,
    so a field is kept only if the grains then fit, else one body and the plain start are tried as well.
    """
    if not course.settings.fields:
        return pose
    width = course.settings.filters[0]
    problem = StateProblem(course.grains, course.filter(width))
    judged = StateProblem(course.grains, course.filter(width, course.settings.gain))  # a drift is no misfit
    stopping = Stopping(course.settings.iterations, max(course.settings.tolerance, 0.02))
    best: Solution[Pose] | None = None
    for candidate in [*reversed(_fields(course, pose)), pose]:
        end = _solve(course, problem, candidate, stopping, f"free, filter {width:g}")
        if best is None or end.costs[-1] < best.costs[-1]:
            best = end
        if lost_grains(judged, best.state).mean() < TOO_MANY:
            break
    assert best is not None
    return best.state


def _fields(course: Course, pose: Pose) -> list[Pose]:
    """One rigid body from the better of two starts, then smooth fields if there are grains enough for them."""
    width = course.settings.field_filter
    problem = StateProblem(course.grains, course.filter(width), stages.rigid)
    starts = [pose, centroid_shift(problem, pose)]
    ends = [_solve(course, problem, s, ROUGHLY, "one body") for s in starts]
    poses = [min(ends, key=lambda e: e.costs[-1]).state]
    fields: list[tuple[str, Basis, int]] = [
        ("affine field", stages.affine, 6),
        ("quadratic field", stages.quadratic, 20),
    ]
    for name, basis, needed in fields:
        if len(course.grains) >= needed:
            problem = StateProblem(course.grains, course.filter(width), basis)
            poses.append(_solve(course, problem, poses[-1], ROUGHLY, name).state)
    return poses


def _free(course: Course, pose: Pose, name: str) -> tuple[StateProblem, Solution[Pose]]:
    """All grains free, filter by filter; gain and offset join once the filter is narrow."""
    settings = course.settings
    for k, width in enumerate(settings.filters):
        gain = settings.gain and (k > 0 or len(settings.filters) == 1)
        problem = StateProblem(course.grains, course.filter(width, gain))
        last = k == len(settings.filters) - 1
        stopping = Stopping(settings.iterations, settings.tolerance if last else max(settings.tolerance, 0.02))
        solution = _solve(course, problem, pose, stopping, f"{name}, filter {width:g}")
        pose = solution.state
    return problem, solution


def _solve(course: Course, problem: StateProblem, pose: Pose, stopping: Stopping, name: str) -> Solution[Pose]:
    norm = float(np.vdot(problem.target.measured, problem.target.measured)) or 1.0

    def observe(cost: float) -> None:
        course.costs.append((name, float(np.sqrt(2 * cost / norm))))
        course.tell(f"{name}: residual {course.costs[-1][1]:.4f}", course.stage)

    course.tell(name, course.stage)
    solution = gauss_newton(problem, pose, stopping, observe)
    course.stage += 1
    return solution
