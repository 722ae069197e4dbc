"""Work of the kernels, counted from their arguments.

`RayWork` of one call is the number of rays it traces and of planes these cross; `count_work` adds it up over a run,
stage by stage, by wrapping the kernels.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from unittest import mock

import numba as nb
import numpy as np

from grainmotion.kernels import grain_projection as kernel
from grainmotion.kernels.grain_ray_tracing import between, ordered, row_of_rays
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import Patches
from grainmotion.projection.grain_arrays import GrainArrays

COUNTED_KERNELS = ("project", "project_with_derivatives")


@dataclass(frozen=True)
class RayWork:
    """Calls, projections of a grain to a view, rays, rays that meet a grain's extents, planes crossed there, and planes
    sampled (whole groups of eight)."""

    calls: int = 0
    projections: int = 0
    rays: int = 0
    meeting: int = 0
    planes: int = 0
    sampled: int = 0

    def __add__(self, other: RayWork) -> RayWork:
        return RayWork(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@nb.njit(error_model="numpy")
def _counted(shapes, corners, extents, voxel, positions, matrices, views, cone, panel, boxes, jobs):
    """Rays that meet a grain, planes crossed and planes sampled, in the order of the kernels."""
    meeting, planes, sampled = 0, 0, 0
    middle = (panel[1] - 1) / 2
    for j in range(len(jobs)):
        p, r, c0, c1 = jobs[j, 0], jobs[j, 1], jobs[j, 2], jobs[j, 3]
        g, i = boxes[p, 0], boxes[p, 1]
        row = r - (panel[0] - 1) / 2
        o0, o1, d0, d1 = row_of_rays(views[i], cone, row, positions[g], matrices[g], corners[g], 1.0 / voxel)
        span = np.empty((2, c1 - c0), np.float32)
        between(extents[g], o0, o1, d0, d1, c0 - middle, span)
        for c in range(c0, c1):
            low, high = span[0, c - c0], span[1, c - c0]
            if low > high:
                continue
            x = c - middle
            o = (o0[0] + x * o1[0], o0[1] + x * o1[1], o0[2] + x * o1[2])
            d = (d0[0] + x * d1[0], d0[1] + x * d1[1], d0[2] + x * d1[2])
            count = ordered(o, d, shapes[g], low, high)[2]
            meeting += 1
            planes += count
            sampled += (count + 7) // 8 * 8
    return meeting, planes, sampled


def work_of_call(grains: GrainTable, views: ViewTable, patches: PatchTable) -> RayWork:
    """The work of one call of a kernel of `kernels.grain_projection`, from its tables."""
    lines = patches.lines
    rays = int((lines[:, 3] - lines[:, 2]).sum())
    tables = (grains.shapes, grains.corners, grains.extents, grains.voxel_size, grains.positions, grains.rotations)
    return RayWork(1, len(patches.boxes), rays, *_counted(*tables, *views, patches.boxes, lines))


def projection_work(packed: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches) -> RayWork:
    """The work of projecting patches once."""
    views = ViewTable(geometry.vectors, geometry.beam == "cone", np.array(geometry.shape))
    return work_of_call(packed.table(pose), views, patches.table)


@dataclass
class WorkLog:
    """Work done within `count_work`, by stage; ``listen`` is passed as the progress callback."""

    stages: dict[str, RayWork] = field(default_factory=lambda: defaultdict(RayWork))
    stage: str = "start"

    def listen(self, message: str, done: int, total: int) -> None:
        """Take a stage's name from a message of progress."""
        self.stage = message.split(":")[0]

    @property
    def whole(self) -> RayWork:
        """All stages together."""
        return sum(self.stages.values(), RayWork())


@contextmanager
def count_work() -> Iterator[WorkLog]:
    """Count the work of all projections of grains within the context."""
    log = WorkLog()

    def counting(name):
        inner = getattr(kernel, name)

        def counted(*arguments):
            log.stages[log.stage] += work_of_call(*arguments[:3])
            inner(*arguments)

        return counted

    with mock.patch.multiple(kernel, **{name: counting(name) for name in COUNTED_KERNELS}):
        yield log
