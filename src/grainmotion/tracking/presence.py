"""Which grains are on the radiographs at all: an amplitude a of every grain at once.

Each grain's filtered line integrals P at a pose near its own enter the filtered radiographs with an unknown amplitude,

    min ‖F (b − Σ a_i P_i − o)‖²,    0 ≤ a_i ≤ 1.3,

with one offset o a view: a drift of the beam.  There is no gain, which would make up for grains that are not there.
Under a filter half a grain wide, a is near 1 for a grain that is there and near 0 for one that is not, however many
are not; decision 0035 holds the measurements.

Missing grains disturb the smooth fields that bring all grains near, so fields are fitted again to grains of these
amplitudes, and amplitudes again at the fields, while the residual falls.  Then each grain may leave the field a
little: its derivatives go with its amplitude, so that a prior holds those that are not there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion._typing import Float, Image
from grainmotion.backends.cpu import CPU
from grainmotion.model.pose import Pose
from grainmotion.objective import displacement_bases
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import body_images
from grainmotion.objective.priors import MotionPrior
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import project_patches
from grainmotion.solvers.block_cg import diagonal_blocks
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.initial_guess import centroid_shift
from grainmotion.tracking.multiresolution import FIELD_GRAIN_PIXELS
from grainmotion.tracking.multistage import MultistageFit

MAX_AMPLITUDE = 1.3
"""Largest amplitude of a grain; misplaced neighbours can give one that is there up to this."""
PRESENT_AMPLITUDE = 0.5
"""Amplitude, over that of the grains which are there, from which a grain is.  21 stones of 20 voxels, 4 or 2 views, 1
to 20 of them gone: 0 to 0.3 (2 views and one gone: 0.6) for those that are gone, 0.6 to 1.3 for the others; with
motions of 5 voxels and 10 degrees beside the field 0 to 0.45 and 0.6 to 1.3."""
ALIKE_AMPLITUDES, LEAST_GAIN = 0.6, 0.4
"""Share of the largest amplitude from which a grain counts for the mean of those that are there; least such mean."""
MAX_SWEEPS, SETTLED_AMPLITUDE = 100, 2e-3
"""Of the bounded least squares: sweeps over all grains at most, and the change of an amplitude that ends them."""
MAX_EMPTY_SHARE = 0.3
"""What filtered radiographs hold beside bodies, liquid and an offset a view (norm), over the weakest shadow of a grain,
up to which no grain is there: 0.005 measured with none, 2 and more with some; grains may lose half of their gain."""
CENSUS_STOPPING = Stopping(iterations=8, step=0.1, decrease=0.05)
"""For fields through grains of some amplitude."""
FIELDS = (
    (displacement_bases.rigid, 1),
    (displacement_bases.rigid, 1),
    (displacement_bases.affine, 6),
    (displacement_bases.affine, 6),
)
"""Fields in turn, and the grains (sum of the amplitudes) from which each is fitted."""
LOOSE_FILTERS, LOOSE_GRAIN_PIXELS = (12.0, 12.0, 6.0, 6.0), 8.0
"""Filters (as in `TrackSettings`) under which each grain leaves the field in turn, and the least coarse pixels across a
grain there."""
LOOSE_STOPPING = Stopping(iterations=4, step=0.1, decrease=0.05)
LOOSE_PRECISION = 0.2
"""Of the prior that holds grains at the field, over the median of what the radiographs tell of a whole grain: one of
amplitude 1 goes five sixths of its way, one of amplitude 0.1 a twentieth."""


@dataclass(frozen=True, eq=False)
class Census:
    """Amplitudes of all grains ``(n,)`` at a pose, and ‖F(b − Σ a P − o)‖ over ‖F b‖ there.

    Bodies and a liquid are taken off b first; a liquid still counts in ‖F b‖.
    """

    pose: Pose
    amplitudes: Float
    residual: float

    @property
    def present(self) -> NDArray[np.bool_]:
        """Grains that are on the radiographs, ``(n,)``."""
        return self.amplitudes >= PRESENT_AMPLITUDE * self.gain

    @property
    def gain(self) -> float:
        """Mean amplitude of the grains that are there: below 1 if the beam hardens or grains lost attenuation."""
        largest = float(self.amplitudes.max(initial=0.0))
        alike = self.amplitudes[self.amplitudes > ALIKE_AMPLITUDES * largest]
        return float(np.clip(alike.mean() if len(alike) else 1.0, LEAST_GAIN, 1.0))


def none_is_there(fit: MultistageFit, start: Pose) -> bool:
    """Whether the radiographs hold less than any single grain would add to them, wherever it went."""
    grains, target = _on_host(*fit.level(fit.settings.field_filter, least=FIELD_GRAIN_PIXELS))
    beside, measured = _beside_grains(target, start), target.measured.astype(float)
    ones = target.filtered(np.ones_like(target.valid)).astype(float)
    left = measured - target.filtered(beside)
    offsets = np.einsum("vrc,vrc->v", left, ones) / np.maximum(np.einsum("vrc,vrc->v", ones, ones), 1e-30)
    shadows = np.sqrt(_shadows(grains, target, start).power(2).sum(axis=0))
    left -= offsets[:, None, None] * ones
    return bool(np.linalg.norm(left) < MAX_EMPTY_SHARE * np.min(shadows, initial=np.inf))


def _beside_grains(target: Target, pose: Pose) -> Image:
    """Line integrals of bodies and of a liquid."""
    views = target.scan.geometry, target.projector
    bodies = body_images(target.bodies, target.nuisance, pose.nuisance, views, target.fixed_background).path
    return bodies if target.fluid is None else bodies + target.fluid


def take_census(fit: MultistageFit, start: Pose, fields: list[Pose]) -> Census:
    """Amplitudes of all grains near the best of ``start`` and ``fields``, and of fields fitted to what is there."""
    best = census_of_fields(fit, start, fields)
    for width in LOOSE_FILTERS:
        best = _loosened(*_on_host(*fit.level(width, least=LOOSE_GRAIN_PIXELS)), best)
    return best


def census_of_fields(fit: MultistageFit, start: Pose, fields: list[Pose]) -> Census:
    """The same before any grain leaves its field."""
    grains, target = _on_host(*fit.level(fit.settings.field_filter, least=FIELD_GRAIN_PIXELS))
    starts = [start, centroid_shift(StateProblem(grains, target, displacement_bases.rigid), start), *fields]
    best = min((count(grains, target, pose) for pose in starts), key=lambda census: census.residual)
    for basis, needed in FIELDS:
        if best.amplitudes.sum() < needed:
            continue
        problem = StateProblem(scaled(grains, best.amplitudes), target, basis)
        census = count(grains, target, gauss_newton(problem, best.pose, CENSUS_STOPPING).state)
        best = min(best, census, key=lambda census: census.residual)
    return best


def _loosened(grains: GrainArrays, target: Target, census: Census) -> Census:
    """The same after each grain left its place as far as its amplitude lets it."""
    blocks = diagonal_blocks(StateProblem(grains, target).linearize(census.pose).hessian)
    shift, rotation = (float(np.median(np.einsum("njj->n", blocks[:, k, k]))) / 3 for k in (slice(3), slice(3, 6)))
    precisions = np.tile(LOOSE_PRECISION * np.diag([shift] * 3 + [rotation] * 3), (len(grains), 1, 1))
    some = scaled(grains, np.minimum(census.amplitudes, 1.0))
    problem = StateProblem(some, target, prior=MotionPrior(census.pose, precisions))
    return count(grains, target, gauss_newton(problem, census.pose, LOOSE_STOPPING).state)


def count_again(fit: MultistageFit, pose: Pose, width: float) -> Census:
    """Amplitudes of all grains at a pose, under a filter of ``width`` pixels."""
    return count(*_on_host(*fit.level(width)), pose)


def count(grains: GrainArrays, target: Target, pose: Pose) -> Census:
    """Amplitudes of all grains at one pose."""
    shadows = _shadows(grains, target, pose)
    count_of_views, pixels = len(target.measured), target.measured[0].size
    ones = target.filtered(np.ones_like(target.valid)).astype(float).ravel()
    owner = np.repeat(np.arange(count_of_views), pixels)
    columns = sparse.hstack(
        [shadows, sparse.csc_array((ones, (np.arange(ones.size), owner)), shape=(ones.size, count_of_views))],
        format="csc",
    )
    bare = replace(target, fluid=None)
    norm = float(np.linalg.norm(target.measured - target.filtered(_beside_grains(bare, pose)))) or 1.0
    measured = (target.measured - target.filtered(_beside_grains(target, pose))).astype(float).ravel()
    n = len(grains)
    low, high = (
        np.append(np.zeros(n), np.full(count_of_views, -np.inf)),
        np.append(np.full(n, MAX_AMPLITUDE), [np.inf] * count_of_views),
    )
    start = np.append(np.ones(n), np.zeros(count_of_views))
    found = bounded_least_squares((columns.T @ columns).tocsr(), columns.T @ measured, start, low, high)
    return Census(pose, found[:n], float(np.linalg.norm(measured - columns @ found)) / norm)


def bounded_least_squares(gram: sparse.csr_array, products: Float, start: Float, low: Float, high: Float) -> Float:
    """x that minimises ½ xᵀGx − pᵀx between bounds, one unknown after the other (projected Gauss–Seidel).

    Unknowns without any effect keep their start.
    """
    x, diagonal = start.copy(), gram.diagonal()
    rows = [slice(a, b) for a, b in zip(gram.indptr[:-1], gram.indptr[1:], strict=True)]
    for _ in range(MAX_SWEEPS):
        before = x.copy()
        for k in np.flatnonzero(diagonal > 0):
            change = products[k] - gram.data[rows[k]] @ x[gram.indices[rows[k]]]
            x[k] = min(max(x[k] + change / diagonal[k], low[k]), high[k])
        if np.abs(x - before).max(initial=0.0) < SETTLED_AMPLITUDE:
            break
    return x


def scaled(grains: GrainArrays, amplitudes: Float) -> GrainArrays:
    """The grains with their attenuation multiplied by amplitudes ``(n,)``."""
    grains = grains.written()
    sizes = grains.shapes.prod(axis=1)
    images = grains.images.copy()
    for start, size, amplitude in zip(grains.starts, sizes, amplitudes, strict=True):
        images[start : start + size] *= grains.precision.type(amplitude)
    return replace(grains, images=images)


def _on_host(grains: GrainArrays, target: Target) -> tuple[GrainArrays, Target]:
    """The same, to be projected and filtered by the processor: a census costs less than to move grains."""
    return replace(grains, backend=CPU, placed=None), replace(target, backend=CPU)


def _shadows(grains: GrainArrays, target: Target, pose: Pose) -> sparse.csc_array:
    """Filtered line integrals of each grain, a column of all pixels each."""
    geometry = target.scan.geometry
    patches = footprint_patches(grains, pose, geometry, margin=len(target.kernel) - 1)
    values = project_patches(grains, pose, geometry, patches, target.projector)[None]
    CPU.filter_patches(values, patches.table, target.root_weights, target.kernel)
    views, rows, columns = target.measured.shape
    pixels = [
        ((view * rows + np.arange(r0, r1))[:, None] * columns + np.arange(c0, c1)).ravel()
        for _, view, r0, r1, c0, c1 in patches.boxes
    ]
    owners = np.repeat(patches.boxes[:, 0], np.diff(patches.offsets))
    places = np.concatenate([*pixels, np.zeros(0, np.int64)])
    return sparse.csc_array((values[0].astype(float), (places, owners)), shape=(views * rows * columns, len(grains)))
