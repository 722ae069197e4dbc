"""The paper's solver, as a baseline: Levenberg–Marquardt on all pixels of all views by forward differences.

The residual is measured − simulated, pixel by pixel, with no filter and no gain; the unknowns are (u, ω) of all
grains at once.  A grain shades few pixels, so that a column of the Jacobian costs one more projection of one
grain, not of the sample: 7 projections of every grain an iteration, 4 in a plane.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse
from threadpoolctl import threadpool_limits

from grainmotion._typing import Projector
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import OUT_OF_PLANE, GrainArrays, planar
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.rotations import rotation_matrix
from validation.paper.counting import Count, counted

Float = NDArray[np.float64]
Method = Literal["dense", "sparse"]
"""``"dense"``: MINPACK's Levenberg–Marquardt; ``"sparse"``: SciPy's ``trf``, a trust region without bounds, by LSMR."""
Matrix = Float | sparse.csr_array
DEFAULT_STEP = 1e-6
"""Of the differences, in voxels that a grain's surface moves; fine, as double precision allows."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the solver ended, and what it took.

    Attributes
    ----------
    motions : Motions
        All of status *converged*, so that only their errors count.
    settled : bool
        Whether a tolerance was met; False when the evaluations ran out.
    iterations : int
        Accepted steps.
    cpu : float
        Seconds.
    count : Count
        What of it was projection.
    path : tuple of (float, Motions)
        CPU seconds and motions at each Jacobian.
    """

    motions: Motions
    settled: bool
    iterations: int
    cpu: float
    count: Count
    path: tuple[tuple[float, Motions], ...]


def fit(
    grains: GrainSet,
    scan: Scan,
    start: Motions | None = None,
    projector: Projector = "trilinear",
    *,
    method: Method = "dense",
    tolerance: float = 1e-8,
    evaluations: int = 200,
    step: float = DEFAULT_STEP,
) -> Fit:
    """Fit the motions of all grains, from zero unless a start is given.

    ``tolerance`` is SciPy's of cost, step and gradient alike, ``evaluations`` the most residuals it may ask for.
    """
    problem = _Problem(grains, scan, projector, start or Motions.identity(grains.labels, grains.centers), method, step)
    problem.residual(problem.first)  # compiles what is timed below
    problem.last = None
    solver = {"method": "lm"} if method == "dense" else {"method": "trf", "tr_solver": "lsmr"}
    with threadpool_limits(limits=1, user_api="blas"), counted() as count:
        begin = time.process_time()
        found = optimize.least_squares(
            problem.residual, problem.first, problem.jacobian, x_scale="jac", max_nfev=evaluations,
            ftol=tolerance, xtol=tolerance, gtol=tolerance, **solver,
        )  # fmt: skip
        cpu = time.process_time() - begin
    path = tuple((at - begin, problem.motions(x)) for at, x in problem.path)
    return Fit(problem.motions(found.x), found.status > 0, len(path) - 1, cpu, count, path)


# ---------------------------------------------------------------------- the problem
@dataclass(eq=False)
class _Evaluation:
    """Residual and Jacobian at one value of the unknowns."""

    x: Float
    patches: Patches
    values: Float
    residual: Float
    jacobian: Matrix | None = None


@dataclass(eq=False)
class _Problem:
    """Residual and Jacobian by the unknowns ``(n, 6)``, or ``(n, 3)`` in a plane, flat.

    Values that SciPy requests twice are computed once.
    """

    grains: GrainSet
    scan: Scan
    projector: Projector
    start: Motions
    method: Method
    step: float
    path: list[tuple[float, Float]] = field(default_factory=list)
    last: _Evaluation | None = None

    def __post_init__(self) -> None:
        packed = GrainArrays.of(self.grains)
        flat = planar(packed, self.scan.geometry)
        self.free = [k for k in range(6) if not (flat and k in OUT_OF_PLANE)]
        self.steps = self.step * packed.voxel_size / np.repeat([1.0, float(packed.radii.max())], 3)
        # Single precision would drown small differences.
        self.packed = replace(packed, images=packed.images.astype(float))
        self.first = np.hstack([self.start.translations, self.start.rotations])[:, self.free].ravel()

    def motions(self, x: Float) -> Motions:
        """The motions that unknowns mean."""
        every = self._every(x)
        statuses = np.full(len(every), Status.CONVERGED.value, dtype="<U20")
        return replace(self.start, translations=every[:, :3], rotations=every[:, 3:], statuses=statuses)

    def residual(self, x: Float) -> Float:
        """Measured − simulated."""
        return self._evaluate(x).residual

    def jacobian(self, x: Float) -> Matrix:
        """Forward differences, of the rotation vector itself."""
        last = self._evaluate(x)
        if last.jacobian is None:
            self.path.append((time.process_time(), x.copy()))
            last.jacobian = self._differences(last)
        return last.jacobian

    def _evaluate(self, x: Float) -> _Evaluation:
        if self.last is None or not np.array_equal(self.last.x, x):
            geometry, every = self.scan.geometry, self._every(x)
            patches = footprint_patches(self.packed, _pose(every), geometry)
            values = self._project(every, patches)
            residual = self.scan.line_integrals - assemble(values, patches, geometry)
            self.last = _Evaluation(x.copy(), patches, values, residual.ravel())
        return self.last

    def _differences(self, last: _Evaluation) -> Matrix:
        every = self._every(last.x)
        derivatives = np.empty((len(self.free), len(last.values)))
        for row, k in zip(derivatives, self.free, strict=True):
            moved = every.copy()
            moved[:, k] += self.steps[k]
            row[:] = (last.values - self._project(moved, last.patches)) / self.steps[k]
        pixels, owners = _places(last.patches, self.scan.line_integrals.shape)
        columns = owners * len(self.free) + np.arange(len(self.free))[:, None]
        shape = len(last.residual), last.x.size
        if self.method == "sparse":
            rows = np.broadcast_to(pixels, derivatives.shape)
            return sparse.csr_array((derivatives.ravel(), (rows.ravel(), columns.ravel())), shape)
        out = np.zeros(shape)
        out[pixels, columns] = derivatives
        return out

    def _project(self, every: Float, patches: Patches) -> Float:
        return project_patches(self.packed, _pose(every), self.scan.geometry, patches, self.projector)

    def _every(self, x: Float) -> Float:
        every = np.zeros((len(self.packed), 6))
        every[:, self.free] = x.reshape(len(every), -1)
        return every


def _pose(every: Float) -> Pose:
    return Pose(every[:, :3], rotation_matrix(every[:, 3:]))


def _places(patches: Patches, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which pixel of the radiographs each one of the patches is, and whose."""
    numbers = np.arange(np.prod(shape)).reshape(shape)
    pixels = [numbers[view, top:bottom, left:right].ravel() for _, view, top, bottom, left, right in patches.boxes]
    return np.concatenate(pixels), np.repeat(patches.boxes[:, 0], np.diff(patches.offsets))
