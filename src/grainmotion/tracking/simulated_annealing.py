"""Simulated annealing of badly fitting grains: all of them at once, over wide ranges of rotations and shifts.

Where many grains overlap in few views, one grain's best place depends on where the others are, and every descent ends
in a local minimum of them all.  So grains are moved one at a time to a candidate drawn with probability
∝ exp(−cost / τ), again and again, while the temperature τ falls (Kirkpatrick et al. 1983; Geman and Geman 1984).
Radiographs and grains are coarse to make that cheap; Gauss–Newton refines the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.backends.cpu import CPU
from grainmotion.kernels import gibbs_sampling as kernel
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import GRAINS_ONLY
from grainmotion.objective.response_parameters import IDENTITY_RESPONSE
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays, ball_directions, planar
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.tracking.multiresolution import coarsened

ANNEALING_FILTER = 0.7
"""Width of the Gaussian filter, pixels of the coarse radiographs."""


@dataclass(frozen=True)
class SearchRanges:
    """How far and how finely to search.

    Attributes
    ----------
    max_rotation : float
        Radians.
    max_shift : float
        Grain diameters.
    grain_pixels : float
        Pixels across a grain on the coarse radiographs.
    shift_step : float
        Pixels between candidate shifts.
    rotation_step : float
        Pixels that a grain's rim moves between candidate rotations.
    sweeps : int
        Visits to each grain.
    heat : float
        Temperature of the first sweep, as a share of the squared residual that a grain has at the start.
    cooling : float
        Last temperature over the first.
    """

    max_rotation: float
    max_shift: float
    grain_pixels: float
    shift_step: float
    rotation_step: float
    sweeps: int
    heat: float = 0.1
    cooling: float = 1e-3


MAX_CANDIDATES = 256, 512
"""Rotations and shifts that are compared at a visit, at most."""
MAX_TABLE_NUMBERS, MIN_TABLE_ROTATIONS = 2**27, 32
"""Numbers in the table of patches; rotations in it however many grains there are."""
BALL_HULL_SCALE = 1.02
"""Of a ball's radius: distance of points around it whose convex hull holds the ball."""
COLD_SWEEPS = 3
"""Sweeps at zero temperature at the end."""
RESIDUAL_BITS = 12
"""Binary digits to which residuals are significant: the largest number is 4,096 quanta.  Products with patches of up
to 10⁴ times that, summed over a thousand pixels, are exact in double precision."""
SHIFT_STEPS_PER_VOXEL, ROTATION_STEPS_PER_RADIAN, DERIVATIVE_STEPS_PER_PIXEL = 16.0, 256.0, 2.0**20
"""Steps to which a start and derivatives are rounded; candidates lie further apart.  Shifts by half a pixel are then
exactly that, so that rounding never decides to which side half a pixel goes."""


def anneal(
    grains: GrainArrays, target: Target, base: Pose, rows: NDArray[np.int64], ranges: SearchRanges, seed: int
) -> Pose:
    """The best pose that annealing reaches for the grains of ``rows`` around ``base``; the others are fixed."""
    base = _rounded(base, rows, grains.unit)
    flat = planar(grains, target.scan.geometry)
    diameter = 2 * float(np.median(grains.radii[rows]))
    pixel = target.scan.geometry.pixel_at((grains.centers + base.translations)[rows].mean(axis=0))
    factor = 1 if flat else max(1, round(diameter / pixel / ranges.grain_pixels))
    coarse = grains.coarsened(factor)
    voxel_size = coarse.voxel_size
    rotations = _candidate_rotations(ranges.max_rotation, 2 * ranges.rotation_step * voxel_size / diameter, flat)
    shifts = _candidate_shifts(ranges.max_shift * diameter, ranges.shift_step * voxel_size, flat)
    derivatives = _pixel_derivatives(target, coarse, base, rows) / factor
    derivatives = np.rint(derivatives * DERIVATIVE_STEPS_PER_PIXEL) / DERIVATIVE_STEPS_PER_PIXEL
    moved = np.abs(np.einsum("nvij,tj->nvti", derivatives, shifts)).max(axis=(0, 1, 2))
    pixels = np.array([0 if flat else max(1, np.ceil(moved[0])), max(1, np.ceil(moved[1]))], dtype=np.int64)
    # Patches keep inside the images at any shift, and grains near the detector's edge keep whole patches.
    margin = pixels + np.array([0 if flat else 1, 1]) + (0 if flat else int(np.ceil(ranges.grain_pixels)))
    view = replace(
        coarsened(target, factor, margin),
        sigma=ANNEALING_FILTER,
        response_model=IDENTITY_RESPONSE,
        nuisance=GRAINS_ONLY,
        weights=None,
        discount=None,
    )
    images = _filtered_residual(coarse, base, view)
    if not images.any():  # no pixel that counts leaves a residual
        return base
    quantum = 2.0 ** (np.ceil(np.log2(float(np.abs(images).max()))) - RESIDUAL_BITS)
    own = Pose(base.translations[rows], base.matrices[rows])
    table = _CandidateTable.of(coarse.select(rows), own, rotations, view, quantum)
    pad = pixels + 1
    images = np.pad(np.rint(images.astype(float) / quantum), ((0, 0), (pad[0], pad[0]), (pad[1], pad[1])))
    heat = ranges.heat * float(np.vdot(images, images)) / len(rows)
    heats = np.concatenate([np.geomspace(heat, heat * ranges.cooling, ranges.sweeps), np.zeros(COLD_SWEEPS)])
    rotation_rows = np.full(len(rows), _identity_row(table.rotations))
    shift_rows = np.full(len(rows), int(np.argmin((shifts**2).sum(axis=1))))
    kernel.anneal(
        np.random.default_rng(seed), counted(heats), MAX_CANDIDATES, images, table.values, table.energies, table.places,
        np.ascontiguousarray(table.boxes[:, [2, 4]] + pad),
        np.ascontiguousarray(table.boxes[:, [3, 5]] - table.boxes[:, [2, 4]]),
        table.offsets, derivatives, shifts, pixels, rotation_rows, shift_rows,
    )  # fmt: skip
    translations, matrices = base.translations.copy(), base.matrices.copy()
    translations[rows] += shifts[shift_rows]
    matrices[rows] = table.rotations[rotation_rows] @ matrices[rows]
    return base.moved(translations, matrices)


@dataclass(frozen=True, eq=False)
class _CandidateTable:
    """Filtered patches of all grains for all rotations, in whole quanta; see `kernels.gibbs_sampling`."""

    rotations: Float
    values: NDArray[np.float32]
    energies: Float
    places: NDArray[np.int64]
    boxes: NDArray[np.int64]
    offsets: NDArray[np.int64]

    @classmethod
    def of(cls, grains: GrainArrays, pose: Pose, rotations: Float, target: Target, quantum: float) -> _CandidateTable:
        geometry = target.scan.geometry
        radii = np.linalg.norm(grains.hulls, axis=2).max(axis=1)
        balls = replace(grains, hulls=radii[:, None, None] * BALL_HULL_SCALE * ball_directions())
        patches = footprint_patches(balls, pose, geometry, margin=len(target.kernel) - 1)
        pixels = int(patches.offsets[-1])
        limit = max(MIN_TABLE_ROTATIONS, MAX_TABLE_NUMBERS // max(pixels, 1))
        if len(rotations) > limit:  # evenly thinned: neighbours on the grid follow each other
            rows = np.linspace(0, len(rotations) - 1, limit).astype(int)
            rotations = rotations[np.unique(np.append(rows, _identity_row(rotations)))]
        values, equal_weights = np.empty((len(rotations), pixels), np.float32), np.ones_like(target.valid)
        for k, rotation in enumerate(counted(rotations)):
            rotated = Pose(pose.translations, rotation @ pose.matrices)
            one = project_patches(grains, rotated, geometry, patches, target.projector)[None]
            CPU.filter_patches(one, patches.table, equal_weights, target.kernel)
            values[k] = np.rint(one[0] / one.dtype.type(quantum))
        places = np.full((len(grains), len(geometry)), -1, np.int64)
        places[patches.boxes[:, 0], patches.boxes[:, 1]] = np.arange(len(patches.boxes))
        energies = np.empty((len(rotations), len(patches.boxes)))
        for p in range(len(patches.boxes)):
            patch = values[:, patches.offsets[p] : patches.offsets[p + 1]].astype(float)
            energies[:, p] = np.einsum("kp,kp->k", patch, patch)
        return cls(rotations, values, energies, places, patches.boxes, patches.offsets)


def _identity_row(rotations: Float) -> int:
    """The row of the identity among rotation matrices."""
    return int(np.argmin(np.linalg.norm(rotations - np.eye(3), axis=(1, 2))))


def _rounded(pose: Pose, rows: NDArray[np.int64], voxel_size: float) -> Pose:
    """The pose with the grains of ``rows`` put on a grid, so that starts that differ by rounding are one."""
    translations, matrices = pose.translations.copy(), pose.matrices.copy()
    translations[rows] = (
        np.rint(translations[rows] / voxel_size * SHIFT_STEPS_PER_VOXEL) * voxel_size / SHIFT_STEPS_PER_VOXEL
    )
    vectors = np.rint(rotation_vector(matrices[rows]) * ROTATION_STEPS_PER_RADIAN) / ROTATION_STEPS_PER_RADIAN
    matrices[rows] = rotation_matrix(vectors)
    return pose.moved(translations, matrices)


def _candidate_rotations(largest: float, step: float, flat: bool) -> Float:
    """Rotation matrices by up to ``largest``, about ``step`` apart (radians), the identity among them."""
    count = int(np.ceil(largest / step))
    steps = np.arange(-count, count + 1) * (largest / max(count, 1))
    vectors = np.stack(np.meshgrid(*([np.zeros(1)] * 2 if flat else [steps] * 2), steps, indexing="ij"), axis=-1)
    vectors = vectors.reshape(-1, 3)
    return rotation_matrix(vectors[np.linalg.norm(vectors, axis=1) <= largest * (1 + 1e-9)])


def _candidate_shifts(largest: float, step: float, flat: bool) -> Float:
    """Shifts no longer than ``largest``, ``step`` apart, zero among them, ``(t, 3)``."""
    count = int(largest / step)
    steps = np.arange(-count, count + 1) * step
    grid = np.stack(np.meshgrid(steps, steps, np.zeros(1) if flat else steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.linalg.norm(grid, axis=1) <= largest * (1 + 1e-9)]


def _pixel_derivatives(target: Target, grains: GrainArrays, pose: Pose, rows: NDArray[np.int64]) -> Float:
    """Pixels (row, column) that each grain's centre moves per unit of shift, ``(n, views, 2, 3)``."""
    geometry, step = target.scan.geometry, grains.voxel_size
    places = (grains.centers + pose.translations)[rows]
    here = geometry.project_points(places)
    there = [geometry.project_points(places + step * axis) for axis in np.eye(3)]
    return np.ascontiguousarray(np.stack([(t - here) / step for t in there], axis=-1).transpose(1, 0, 2, 3))


def _filtered_residual(grains: GrainArrays, pose: Pose, target: Target) -> Image:
    """Filtered measured − simulated, all grains at ``pose``."""
    geometry = target.scan.geometry
    patches = footprint_patches(grains, pose, geometry)
    simulated = assemble(project_patches(grains, pose, geometry, patches, target.projector), patches, geometry)
    others = target.fixed_background if target.fluid is None else target.fixed_background + target.fluid
    return target.measured - target.filtered(simulated + others)
