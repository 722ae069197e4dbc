"""Simulated annealing of badly fitting grains: all of them at once, over wide ranges of turns and shifts.

Where many grains overlap in few views, one grain's best place depends on where the others are, and descent of
any kind ends in a wrong valley of them all.  So grains are moved one at a time to a candidate drawn with
probability ∝ exp(−cost / τ), again and again, while the heat τ falls (Kirkpatrick et al. 1983; Geman and Geman
1984).  Radiographs and grains are coarse enough to make that cheap; Gauss–Newton does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.kernels import gibbs_sampling as kernel
from grainmotion.kernels import normal_equations
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import GRAINS_ONLY
from grainmotion.objective.response_parameters import IDENTITY_RESPONSE
from grainmotion.projection.grain_arrays import GrainArrays, ball_directions, planar
from grainmotion.projection.grains import assemble, project_patches, shadows
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.tracking.multiresolution import coarsened

ANNEALING_FILTER = 0.7  # pixels of the coarse radiographs


@dataclass(frozen=True)
class SearchRanges:
    """How far and how finely to search.

    Attributes
    ----------
    angle : float
        Largest turn, radians.
    reach : float
        Largest shift, grain diameters.
    across : float
        Pixels across a grain on the coarse radiographs.
    step : float
        Pixels between candidate shifts.
    turn_step : float
        Pixels that a grain's rim moves between candidate turns.
    sweeps : int
        Visits to each grain.
    heat : float
        Of the first sweep, as a share of the residual that a grain has at the start.
    cooling : float
        Last heat over the first.
    """

    angle: float
    reach: float
    across: float
    step: float
    turn_step: float
    sweeps: int
    heat: float = 0.1
    cooling: float = 1e-3


MAX_CANDIDATES = 256, 512
"""Turns and shifts weighed at a visit, at most."""
MAX_TABLE_NUMBERS, MIN_TABLE_ROTATIONS = 2**27, 32
"""Numbers in the table of patches; turns in it however many grains there are."""
BALL_HULL_SCALE = 1.02
"""Of a ball's radius: how far out points on it must lie so that they hold it between them."""
COLD_SWEEPS = 3
"""Sweeps without heat at the end."""
RESIDUAL_BITS = 12
"""Binary digits to which residuals are significant: the largest number is 4,096 quanta.  Products with patches of up
to 10⁴ times that, summed over a thousand pixels, are exact in double precision."""
SHIFT_STEPS_PER_VOXEL, ROTATION_STEPS_PER_RADIAN, DERIVATIVE_STEPS_PER_PIXEL = 16.0, 256.0, 2.0**20
"""Steps to which a start is significant, of a voxel and of a radian (candidates lie further apart), and slopes are:
shifts by half a pixel are then exactly that, and no rounding says to which side a pixel's half goes."""


def anneal(
    grains: GrainArrays, target: Target, base: Pose, rows: NDArray[np.int64], ranges: SearchRanges, seed: int
) -> Pose:
    """The best pose that annealing finds for the grains of ``rows`` around ``base``; the others are held."""
    base = _rounded(base, rows, grains.unit)
    flat = planar(grains, target.scan.geometry)
    diameter = 2 * float(np.median(grains.radii[rows]))
    pixel = target.scan.geometry.pixel_at((grains.centers + base.translations)[rows].mean(axis=0))
    factor = 1 if flat else max(1, round(diameter / pixel / ranges.across))
    coarse = grains.coarsened(factor)
    h = coarse.voxel_size
    turns = _turns(ranges.angle, 2 * ranges.turn_step * h / diameter, flat)
    shifts = _shifts(ranges.reach * diameter, ranges.step * h, flat)
    slopes = (
        np.rint(_slopes(target, coarse, base, rows) / factor * DERIVATIVE_STEPS_PER_PIXEL) / DERIVATIVE_STEPS_PER_PIXEL
    )
    moved = np.abs(np.einsum("nvij,tj->nvti", slopes, shifts)).max(axis=(0, 1, 2))
    reach = np.array([0 if flat else max(1, np.ceil(moved[0])), max(1, np.ceil(moved[1]))], dtype=np.int64)
    # Patches keep inside the images at any shift, and grains near the panel's edge keep whole patches.
    margin = reach + np.array([0 if flat else 1, 1]) + (0 if flat else int(np.ceil(ranges.across)))
    view = replace(
        coarsened(target, factor, margin),
        sigma=ANNEALING_FILTER,
        response_model=IDENTITY_RESPONSE,
        nuisance=GRAINS_ONLY,
        weights=None,
    )
    chosen = coarse.select(rows)
    own = Pose(base.translations[rows], base.matrices[rows])
    images = _residual(coarse, base, view)
    if not images.any():  # nothing that counts is to be explained
        return base
    quantum = 2.0 ** (np.ceil(np.log2(float(np.abs(images).max()))) - RESIDUAL_BITS)
    table = _CandidateTable.of(chosen, own, turns, view, quantum)
    pad = reach + 1
    images = np.pad(np.rint(images.astype(float) / quantum), ((0, 0), (pad[0], pad[0]), (pad[1], pad[1])))
    heat = ranges.heat * float(np.vdot(images, images)) / len(rows)
    heats = np.concatenate([np.geomspace(heat, heat * ranges.cooling, ranges.sweeps), np.zeros(COLD_SWEEPS)])
    which = np.full(len(rows), _still(table.turns))
    moves = np.full(len(rows), int(np.argmin((shifts**2).sum(axis=1))))
    kernel.anneal(
        np.random.default_rng(seed), heats, MAX_CANDIDATES, images, table.values, table.energies, table.places,
        table.boxes[:, [2, 4]] + pad, np.ascontiguousarray(table.boxes[:, [3, 5]] - table.boxes[:, [2, 4]]),
        table.offsets, slopes, shifts, reach, which, moves,
    )  # fmt: skip
    translations, matrices = base.translations.copy(), base.matrices.copy()
    translations[rows] += shifts[moves]
    matrices[rows] = table.turns[which] @ matrices[rows]
    return base.moved(translations, matrices)


@dataclass(frozen=True, eq=False)
class _CandidateTable:
    """Filtered patches of all grains for all turns, in whole quanta; see `kernels.gibbs_sampling`."""

    turns: Float
    values: NDArray[np.float32]
    energies: Float
    places: NDArray[np.int64]
    boxes: NDArray[np.int64]
    offsets: NDArray[np.int64]

    @classmethod
    def of(cls, grains: GrainArrays, pose: Pose, turns: Float, target: Target, quantum: float) -> _CandidateTable:
        geometry = target.scan.geometry
        reach = np.linalg.norm(grains.hulls, axis=2).max(axis=1)
        ball = replace(grains, hulls=reach[:, None, None] * BALL_HULL_SCALE * ball_directions())
        patches = shadows(ball, pose, geometry, margin=len(target.kernel) - 1)
        pixels = int(patches.offsets[-1])
        most = max(MIN_TABLE_ROTATIONS, MAX_TABLE_NUMBERS // max(pixels, 1))
        if len(turns) > most:  # evenly thinned: neighbours on the grid follow each other
            turns = turns[np.unique(np.append(np.linspace(0, len(turns) - 1, most).astype(int), _still(turns)))]
        values, all_alike = np.empty((len(turns), pixels), np.float32), np.ones_like(target.valid)
        for k, turn in enumerate(turns):
            turned = Pose(pose.translations, turn @ pose.matrices)
            one = project_patches(grains, turned, geometry, patches, target.projector)[None]
            normal_equations.filter_patches(one, patches.boxes, patches.offsets, all_alike, target.kernel)
            values[k] = np.rint(one[0] / one.dtype.type(quantum))
        places = np.full((len(grains), len(geometry)), -1, np.int64)
        places[patches.boxes[:, 0], patches.boxes[:, 1]] = np.arange(len(patches.boxes))
        energies = np.empty((len(turns), len(patches.boxes)))
        for p in range(len(patches.boxes)):
            mine = values[:, patches.offsets[p] : patches.offsets[p + 1]].astype(float)
            energies[:, p] = np.einsum("kp,kp->k", mine, mine)
        return cls(turns, values, energies, places, patches.boxes, patches.offsets)


def _still(turns: Float) -> int:
    """The turn that is none."""
    return int(np.argmin(np.linalg.norm(turns - np.eye(3), axis=(1, 2))))


def _rounded(pose: Pose, rows: NDArray[np.int64], voxel: float) -> Pose:
    """The pose with the grains of ``rows`` put on a grid, so that starts that differ by rounding are one."""
    translations, matrices = pose.translations.copy(), pose.matrices.copy()
    translations[rows] = np.rint(translations[rows] / voxel * SHIFT_STEPS_PER_VOXEL) * voxel / SHIFT_STEPS_PER_VOXEL
    matrices[rows] = rotation_matrix(
        np.rint(rotation_vector(matrices[rows]) * ROTATION_STEPS_PER_RADIAN) / ROTATION_STEPS_PER_RADIAN
    )
    return pose.moved(translations, matrices)


def _turns(largest: float, step: float, flat: bool) -> Float:
    """Rotation matrices no further than ``largest`` from none, about ``step`` apart (radians); none among them."""
    count = int(np.ceil(largest / step))
    steps = np.arange(-count, count + 1) * (largest / max(count, 1))
    vectors = np.stack(np.meshgrid(*([np.zeros(1)] * 2 if flat else [steps] * 2), steps, indexing="ij"), axis=-1)
    vectors = vectors.reshape(-1, 3)
    return rotation_matrix(vectors[np.linalg.norm(vectors, axis=1) <= largest * (1 + 1e-9)])


def _shifts(largest: float, step: float, flat: bool) -> Float:
    """Shifts no longer than ``largest``, ``step`` apart, none among them, ``(t, 3)``."""
    count = int(largest / step)
    steps = np.arange(-count, count + 1) * step
    grid = np.stack(np.meshgrid(steps, steps, np.zeros(1) if flat else steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.linalg.norm(grid, axis=1) <= largest * (1 + 1e-9)]


def _slopes(target: Target, grains: GrainArrays, pose: Pose, rows: NDArray[np.int64]) -> Float:
    """Pixels (row, column) that each grain's centre moves per unit of shift, ``(n, views, 2, 3)``."""
    geometry, h = target.scan.geometry, grains.voxel_size
    places = (grains.centers + pose.translations)[rows]
    here = geometry.project_points(places)
    there = [geometry.project_points(places + h * axis) for axis in np.eye(3)]
    return np.ascontiguousarray(np.stack([(t - here) / h for t in there], axis=-1).transpose(1, 0, 2, 3))


def _residual(grains: GrainArrays, pose: Pose, target: Target) -> Image:
    """Filtered measured − simulated, all grains at ``pose``."""
    geometry = target.scan.geometry
    patches = shadows(grains, pose, geometry)
    simulated = assemble(project_patches(grains, pose, geometry, patches, target.projector), patches, geometry)
    return target.measured - target.filtered(simulated + target.fixed_background)
