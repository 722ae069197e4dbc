"""From the start to where all grains are near: one body, then a smooth field."""

from __future__ import annotations

from grainmotion.packed import Pose
from grainmotion.solve import Solution
from grainmotion.tracking import stages
from grainmotion.tracking.coarse import TOGETHER
from grainmotion.tracking.course import ROUGHLY, Course
from grainmotion.tracking.misfit import misfits
from grainmotion.tracking.residual import Basis, StateProblem
from grainmotion.tracking.starts import centroid_shift

TOO_MANY = 0.1  # share of badly fitting grains from which another start is tried


def approach(course: Course, pose: Pose) -> tuple[Pose, Pose]:
    """A smooth field's pose, and the pose from which the free stages start well.

    A smooth field that carries the sample far can mislead grains that moved little and each its own way,
    so a field is kept only if the grains then fit, else one body and the plain start are tried as well.
    """
    if not course.settings.fields:
        return pose, pose
    width = course.settings.filters[0]
    problem = StateProblem(*course.level(width))
    judged = StateProblem(course.grains, course.filter(width, course.settings.freedom.midway))  # a drift is no misfit
    best: Solution[Pose] | None = None
    fields = smooth_fields(course, pose)
    for candidate in [*reversed(fields), pose]:
        end = course.solve(problem, candidate, course.rough(), f"free, filter {width:g}")
        if best is None or end.costs[-1] < best.costs[-1]:
            best = end
        seen = judged.glance(best.state)
        if (misfits(judged, seen).astray & seen.patches.seen.any(axis=1)).mean() < TOO_MANY:
            break
    assert best is not None
    return fields[-1], best.state


def smooth_fields(course: Course, pose: Pose) -> list[Pose]:
    """One rigid body from the better of two starts, then smooth fields if there are grains enough for them."""
    width = course.settings.field_filter
    grains, target = course.level(width, least=TOGETHER)
    problem = StateProblem(grains, target, stages.rigid)
    starts = [pose, centroid_shift(problem, pose)]
    ends = [course.solve(problem, s, ROUGHLY, "one body") for s in starts]
    poses = [min(ends, key=lambda e: e.costs[-1]).state]
    fields: list[tuple[str, Basis, int]] = [
        ("affine field", stages.affine, 6),
        ("quadratic field", stages.quadratic, 20),
    ]
    for name, basis, needed in fields:
        if len(course.grains) >= needed:
            problem = StateProblem(grains, target, basis)
            poses.append(course.solve(problem, poses[-1], ROUGHLY, name).state)
    return poses
