"""The paper's solver, as a baseline: Levenberg–Marquardt on all pixels of all views by forward differences.

The residual is measured − simulated, pixel by pixel, with no filter and no gain; the unknowns are (u, ω) of all
grains at once.  A grain shades few pixels, so that a column of the Jacobian costs one more projection of one
grain, not of the sample: 7 projections of every grain an iteration, 4 in a plane.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from threadpoolctl import threadpool_limits

from grainmotion import motion
from grainmotion.grains import GrainSet
from grainmotion.kernels import grains as kernel
from grainmotion.motions import Motions, Status
from grainmotion.packed import OUT_OF_PLANE, PackedGrains, Pose, planar
from grainmotion.project import Projector, assemble, project_patches, shadows
from grainmotion.scan import Scan

Float = NDArray[np.float64]
STEP = 1e-6
"""Of the differences, in voxels that a grain's surface moves; fit for double precision."""
WALKS = ("project", "project_with_derivatives")


@dataclass
class Count:
    """Projections of a grain to a view so far."""

    walks: int = 0


@contextmanager
def counted() -> Iterator[Count]:
    """Count projections of grains while it lasts: one a grain and view, be it with derivatives or without."""
    count = Count()

    def wrapped(name: str):  # noqa: ANN202 – of the kernel's own type
        inner = getattr(kernel, name)

        def walk(*arguments):
            count.walks += len(arguments[10])  # boxes, one a grain and view
            return inner(*arguments)

        return walk

    with mock.patch.multiple(kernel, **{name: wrapped(name) for name in WALKS}):
        yield count


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the baseline ended, and what it took.

    ``iterations`` are Jacobians taken, one an accepted step; ``path`` holds the CPU seconds and the motions at
    each of them; ``projecting`` and ``cpu`` are CPU seconds, of projections and of all.
    """

    motions: Motions
    settled: bool
    iterations: int
    evaluations: int
    walks: int
    cpu: float
    projecting: float
    path: tuple[tuple[float, Motions], ...]


def fit(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None = None,
    projector: Projector = "trilinear",
    tolerance: float = 1e-8,
    evaluations: int = 200,
    method: str = "lm",
    **options: object,
) -> Fit:
    """Fit the motions of all grains; ``tolerance`` is SciPy's of cost, step and gradient, one number for all three."""
    start = start or Motions.identity(grains.labels, grains.centers)
    problem = _Problem(grains, scan, projector)
    x = problem.unknowns(start)
    problem.residual(x)  # compiles
    problem.reset()
    with threadpool_limits(limits=1, user_api="blas"), counted() as count:
        begin = time.process_time()
        found = optimize.least_squares(
            problem.residual, x, problem.jacobian, method=method, x_scale="jac",
            ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=evaluations, **options,
        )  # fmt: skip
        cpu = time.process_time() - begin
    path = tuple((at - begin, problem.motions(start, y)) for at, y in problem.path)
    return Fit(
        problem.motions(start, found.x), found.status > 0, len(path), found.nfev, count.walks, cpu,
        problem.projecting, path,
    )  # fmt: skip


@dataclass(eq=False)
class _Problem:
    """Residual and Jacobian by the unknowns ``(n, 6)``, or ``(n, 3)`` in a plane, flat."""

    grains: GrainSet
    scan: Scan
    projector: Projector
    projecting: float = 0.0
    path: list[tuple[float, Float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        packed = PackedGrains.of(self.grains)
        # single precision would drown such small differences
        self.packed = replace(packed, images=packed.images.astype(float))
        flat = planar(packed, self.scan.geometry)
        self.free = [k for k in range(6) if not (flat and k in OUT_OF_PLANE)]
        self.steps = STEP * packed.voxel_size / np.where(np.arange(6) < 3, 1.0, packed.radii.max())
        self.reset()

    def reset(self) -> None:
        """Forget all that was seen."""
        self.seen = None
        self.path, self.projecting = [], 0.0

    def unknowns(self, motions: Motions) -> Float:
        """Of motions of the same grains."""
        return np.hstack([motions.translations, motions.rotations])[:, self.free].ravel()

    def motions(self, start: Motions, x: Float) -> Motions:
        """Motions of unknowns."""
        every = self._full(x)
        statuses = np.full(len(every), Status.CONVERGED.value, dtype="<U20")  # so that errors alone judge it
        return replace(start, translations=every[:, :3], rotations=every[:, 3:], statuses=statuses)

    def residual(self, x: Float) -> Float:
        """Measured − simulated."""
        geometry = self.scan.geometry
        begin = time.process_time()
        patches = shadows(self.packed, _pose(self._full(x)), geometry)
        values = self._project(self._full(x), patches)
        simulated = assemble(values, patches, geometry)
        self.projecting += time.process_time() - begin
        self.seen = x.copy(), patches, values
        return (self.scan.line_integrals - simulated).ravel()

    def jacobian(self, x: Float) -> Float:
        """Forward differences; the rotation vector itself is what is stepped."""
        if not np.array_equal(self.seen[0], x):  # a rejected step came between
            self.residual(x)
        _, patches, values = self.seen
        begin = time.process_time()
        self.path.append((begin, x.copy()))
        every, n = self._full(x), len(self.packed)
        out = np.zeros((*self.scan.line_integrals.shape, n, len(self.free)))
        for j, k in enumerate(self.free):
            moved = every.copy()
            moved[:, k] += self.steps[k]
            slopes = (values - self._project(moved, patches)) / self.steps[k]
            for (grain, view, top, bottom, left, right), at in zip(patches.boxes, patches.offsets, strict=False):
                size = (bottom - top) * (right - left)
                out[view, top:bottom, left:right, grain, j] = slopes[at : at + size].reshape(bottom - top, -1)
        self.projecting += time.process_time() - begin
        return out.reshape(-1, n * len(self.free))

    def _project(self, every: Float, patches) -> Float:
        return project_patches(self.packed, _pose(every), self.scan.geometry, patches, self.projector)

    def _full(self, x: Float) -> Float:
        every = np.zeros((len(self.packed), 6))
        every[:, self.free] = x.reshape(len(every), -1)
        return every


def _pose(every: Float) -> Pose:
    return Pose(every[:, :3], motion.exp(every[:, 3:]))
