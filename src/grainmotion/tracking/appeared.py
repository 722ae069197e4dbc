"""A grain that appeared: one that stands in for it keeps it from shaking the others.

Attenuation that no grain explains pulls all grains towards it.  A ball of the usual size and attenuation, put
where the radiographs hold most of it and free to move, takes it up; its own motion is not told.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.grains import PADDING, Grain, GrainSet
from grainmotion.motions import Motions
from grainmotion.packed import Pose
from grainmotion.tracking.approach import smooth_fields
from grainmotion.tracking.course import Course
from grainmotion.tracking.residual import StateProblem
from grainmotion.tracking.strangers import stranger_places
from grainmotion.volume import Volume

Float = NDArray[np.float64]

SURPLUS = 0.3
"""Of one grain's share of all attenuation: by as much the fitted gain exceeds 1 where one has appeared."""
IN_DOUBT = 0.3
"""Share of grains that must be in doubt before another one is supposed."""


def may_have_appeared(measured: Motions) -> bool:
    """Whether a fit looks as if a grain too many were on the radiographs."""
    return bool((~measured.ok).mean() > IN_DOUBT and measured.fit.gain > 1 + SURPLUS / len(measured))


def place_of_surplus(course: Course, start: Pose) -> Float | None:
    """Where most attenuation is unexplained once a smooth field has carried the grains, mm, x y z."""
    base = smooth_fields(course, start)[-1]
    problem = StateProblem(course.grains, course.filter(course.settings.filters[0]))
    places = stranger_places(problem, base, problem.glance(base))
    return np.array(places[0][:3]) if places else None


def with_stand_in(grains: GrainSet, place: Float) -> GrainSet:
    """The sample with a ball at ``place`` (mm, x y z), labelled one beyond the others."""
    masses = [float(g.volume.array.sum(dtype=float)) for g in grains.grains]
    attenuation = float(np.median(np.concatenate([g.volume.array[g.volume.array > 0] for g in grains.grains])))
    radius = grains.voxel_size * float(np.cbrt(3 * np.median(masses) / (4 * np.pi * attenuation)))
    fine = next((g.fine.voxel_size for g in grains.grains if g.fine is not None), None)
    ball = Grain(
        int(grains.labels.max()) + 1,
        _ball(place, radius, attenuation, grains.voxel_size, grains.precision),
        np.asarray(place, dtype=float),
        fine=None if fine is None else _ball(place, radius, attenuation, fine, grains.precision),
    )
    return replace(grains, grains=(*grains.grains, ball))


def started(start: Motions | None, grains: GrainSet) -> Motions | None:
    """The start of the sample with a stand-in, which moves from where it was put."""
    if start is None:
        return None
    ball = Motions.identity(grains.labels[-1:], grains.centers[-1:])
    names = ("labels", "centers", "translations", "rotations", "covariances", "statuses", "residuals", "iterations")
    rows: dict[str, Any] = {name: np.concatenate([getattr(start, name), getattr(ball, name)]) for name in names}
    return replace(start, **rows, reasons=(*start.reasons, ""))


def _ball(place: Float, radius: float, attenuation: float, h: float, precision: np.dtype[np.floating]) -> Volume:
    reach = int(np.ceil(radius / h)) + PADDING + 1
    z, y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1, -reach : reach + 1]
    array = attenuation * np.clip(radius / h - np.sqrt(x**2 + y**2 + z**2) + 0.5, 0, 1)
    return Volume(array.astype(precision), h, (float(place[0]), float(place[1]), float(place[2])))


def without_last(measured: Motions) -> Motions:
    """The motions of all but the stand-in, with a note on it."""
    x, y, z = measured.centers[-1] + np.nan_to_num(measured.translations[-1])
    note = (
        f"a grain has appeared near x = {x:.3g}, y = {y:.3g}, z = {z:.3g}: a ball stands in for it so that it does "
        "not shake the others; check the reference for it"
    )
    return measured.first(len(measured) - 1, note)
