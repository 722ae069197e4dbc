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
from grainmotion.kernels.cuda.grain_ray_tracing import ordered
from grainmotion.kernels.grain_projection import at_columns, span_of_columns, span_of_row
from grainmotion.kernels.grain_ray_packets import PACKET_SIZE, crossing, dominant
from grainmotion.kernels.grain_ray_tracing import row_of_rays
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.kernels.vector_functions import any_lane, counted
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import Patches
from grainmotion.projection.grain_arrays import GrainArrays

COUNTED_KERNELS = ("project", "project_with_derivatives")


@dataclass(frozen=True)
class RayWork:
    """Calls, projections of a grain to a view, rays, rays that meet a grain's extents, planes crossed there, and planes
    sampled (those of eight rays, from the first to the last that any of them crosses)."""

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
        rays = row_of_rays(views[i], cone, row, positions[g], matrices[g], corners[g], 1.0 / voxel)
        span = span_of_row(extents[g], rays, c0 - middle, c1 - c0)
        for c in range(c0, c1):
            low, high = span[0, c - c0], span[1, c - c0]
            if low > high:
                continue
            o, d = at_columns(rays[0], rays[1], c - middle), at_columns(rays[2], rays[3], c - middle)
            meeting += 1
            planes += ordered(o, d, shapes[g], low, high)[2]
        for c in range(c0, c1, PACKET_SIZE):
            lows, highs = span_of_columns(span, c - c0, min(c1 - c, PACKET_SIZE))
            x = counted(c - middle, PACKET_SIZE)
            os, ds = at_columns(rays[0], rays[1], x), at_columns(rays[2], rays[3], x)
            for axis in range(3):
                own = (lows <= highs) & dominant(ds, axis)
                if any_lane(own):
                    first, end, _ = crossing(shapes[g], os, ds, lows, highs, own, axis)[0]
                    sampled += PACKET_SIZE * max(end - first, 0)
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
