"""Near-symmetries of grains: the rotations and mirrored rotations under which a grain looks like itself.

The attenuation on spheres about a grain's centre of mass, μ(r, x̂) = Σ c_lm(r) Y_lm(x̂) up to degree `DEGREE`, overlaps
with itself rotated by R, with Euler angles (α, β, γ) about z, y, z, by

    C(R) = Σ_lmm' A_lmm' e^(−imα) d^l_mm'(β) e^(−im'γ),    A_lmm' = ∫ r² conj(c_lm) c_lm' dr,

which is a Fourier transform for each β (Kostelec and Rockmore, J. Fourier Anal. Appl. 14, 2008).  An inversion
multiplies A_lmm' by (−1)^l, so that the same sum serves mirrored grains.  Without the round part l = 0, and over its
value at R = 1, C is the likeness: 1 for a symmetry, near 0 for a rotation that has nothing to do with the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from grainmotion._typing import Float, Image
from grainmotion.model import task_map
from grainmotion.model.grains import Grain
from grainmotion.projection.grain_arrays import GrainArrays

DEGREE = 8
"""Of the spherical harmonics: a cube's begin with 4, those of a hexagonal prism about its axis with 6."""
DIRECTION_COUNT, RADIUS_COUNT = 256, 12
"""Points of a sphere and spheres at which a grain is sampled."""
EULER_STEPS = 30
"""Steps of α and γ in a full turn, and of β, of the same size."""
MIN_GRID_LIKENESS, MIN_LIKENESS = 0.82, (0.88, 0.92)
"""Likeness of a near-symmetry: on the grid of rotations, which lie up to 10° beside it, and after each refinement.
Voxels of cubes, prisms, octahedra and ellipsoids 16 across have 0.87 and 0.968 at least with 10 % noise, 0.84 and 0.932
with 20 %; of 95 gravel stones one has a rotation with more than 0.93, and a ball has none."""
NOISE_SHARE = 1e-3
"""Share of a grain's power that is noise of its voxels, which no rotation carries to itself.

Balls have 0.0004 to 0.0012 beside their round part (20 voxels across, 45 views, SNR 50), nearly round ellipsoids 0.003
to 0.1, stones 0.09 to 0.33.  The likeness of an ellipsoid with 0.007 is 0.82 to 0.88."""
MIN_NOISY_LIKENESS = 0.6
"""The bounds fall with the noise, to this share of a grain whose power beside the round part is noise alone."""
MIN_DISTANCE = np.deg2rad(25.0)
"""Between two near-symmetries, and between one and the identity: the width of a peak of C."""
MAX_SYMMETRIES = 64
"""Near-symmetries of a grain that are kept, the best: a cube has 47, an icosahedron 119."""
GRAINS_OF_A_CALL = 32
"""Grains that a worker looks at in one call."""
MIN_SINE = 1e-7
"""Sine of β from which α and γ are determined each."""
REFINEMENT_STEPS = (np.deg2rad(8.0), np.deg2rad(4.0))
"""Steps of the finite differences with which a maximum is refined."""


@dataclass(frozen=True, eq=False)
class NearSymmetries:
    """Linear maps ``matrices (k, 3, 3)`` that carry a grain nearly to itself, with their ``likeness (k,)``.

    Determinants are 1 for rotations and −1 for mirrored ones; the identity is left out.
    """

    matrices: Float
    likeness: Float


def near_symmetries(grains: GrainArrays, row: int) -> NearSymmetries:
    """The near-symmetries of one grain about its centre of mass."""
    power = _power(grains, row)
    round_part = float(power[0].trace().real)
    power[0] = 0
    own = _overlaps(power, np.eye(3)[None])[0]
    if own <= 0:
        return NearSymmetries(np.zeros((0, 3, 3)), np.zeros(0))
    kept = max(1 - NOISE_SHARE * (own + round_part) / own, MIN_NOISY_LIKENESS)
    matrices, likeness = list[Float](), list[Float]()
    signs = (-1.0) ** np.arange(DEGREE + 1)[:, None, None]
    for sign, each in ((1.0, power), (-1.0, power * signs)):
        found = _peaks(_grid_overlaps(each) / own, kept * MIN_GRID_LIKENESS)
        if sign > 0:
            found = found[angles_between(found, np.eye(3)) > MIN_DISTANCE]
        for step, least in zip(REFINEMENT_STEPS, MIN_LIKENESS, strict=True):
            found = _refined(each, found, step)
            values = _overlaps(each, found) / own
            found, values = found[values > kept * least], values[values > kept * least]
        order = np.argsort(-values, kind="stable")
        first = order[_first_of_each(found[order])]
        matrices.append(sign * found[first])
        likeness.append(values[first])
    every, values = np.concatenate(matrices), np.concatenate(likeness)
    best = np.argsort(-values, kind="stable")[:MAX_SYMMETRIES]
    return NearSymmetries(every[best], values[best])


_SYMMETRIES_OF_GRAINS = WeakKeyDictionary[Grain, NearSymmetries]()


def known_symmetries(grain: Grain, grains: GrainArrays, row: int) -> NearSymmetries:
    """`near_symmetries` of ``grain``, which is in a row of ``grains``; found once, however many states it is in."""
    if grain not in _SYMMETRIES_OF_GRAINS:
        _SYMMETRIES_OF_GRAINS[grain] = near_symmetries(grains, row)
    return _SYMMETRIES_OF_GRAINS[grain]


def find_symmetries(grains: Sequence[Grain], arrays: GrainArrays, rows: Sequence[int]) -> None:
    """Find what `known_symmetries` will be asked of these rows, where workers share the work."""
    new = [row for row in rows if grains[row] not in _SYMMETRIES_OF_GRAINS]
    if not task_map.is_shared() or not new:
        return
    groups = [np.array(new[k : k + GRAINS_OF_A_CALL]) for k in range(0, len(new), GRAINS_OF_A_CALL)]
    for group, found in zip(groups, task_map.each(_symmetries_of_each, map(arrays.alone, groups)), strict=True):
        _SYMMETRIES_OF_GRAINS.update((grains[row], symmetries) for row, symmetries in zip(group, found, strict=True))


def _symmetries_of_each(grains: GrainArrays) -> list[NearSymmetries]:
    return [near_symmetries(grains, row) for row in range(len(grains))]


def angles_between(left: Float, right: Float) -> Float:
    """Angles of the rotations between matrices ``(..., 3, 3)``, radians."""
    trace = np.einsum("...ij,...ij->...", left, right)
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


def _power(grains: GrainArrays, row: int) -> NDArray[np.complex128]:
    """A_lmm' of a grain, ``(DEGREE + 1, 2 DEGREE + 1, 2 DEGREE + 1)``."""
    coefficients = _samples(grains, row) @ _harmonics()  # (l, radii, m)
    power: NDArray[np.complex128] = coefficients.conj().swapaxes(1, 2) @ coefficients
    return power


def _samples(grains: GrainArrays, row: int) -> NDArray[np.complex128]:
    """Attenuation at points of spheres about the centre of mass ``(radii, directions)``, times √(r² dr)."""
    shape = grains.shapes[row]
    image = grains.voxels_of(row).reshape(shape)
    reach = np.linalg.norm(grains.hulls[row], axis=1).max() + grains.voxel_size
    radii = reach * (np.arange(RADIUS_COUNT) + 0.5) / RADIUS_COUNT
    points = radii[:, None, None] * _directions() - grains.corners[row]
    places = points.reshape(-1, 3).T[::-1] / grains.voxel_size
    values: Image = map_coordinates(image, places, order=1, output=np.float32)
    return values.reshape(RADIUS_COUNT, DIRECTION_COUNT) * (radii / reach)[:, None]


@lru_cache(maxsize=1)
def _directions() -> Float:
    """Unit vectors evenly over a sphere ``(DIRECTION_COUNT, 3)``."""
    k = np.arange(DIRECTION_COUNT) + 0.5
    height, angle = 1 - 2 * k / DIRECTION_COUNT, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])


@lru_cache(maxsize=1)
def _harmonics() -> NDArray[np.complex128]:
    """Conjugate spherical harmonics of each degree and order at `_directions`, ``(l, directions, m)``."""
    x, y, z = _directions().T
    degree, order = np.arange(DEGREE + 1)[:, None, None], np.arange(-DEGREE, DEGREE + 1)
    inside = np.abs(order) <= degree
    values = sph_harm_y(degree, np.where(inside, order, 0), np.arccos(z)[:, None], np.arctan2(y, x)[:, None])
    return np.where(inside, values.conj(), 0)


@lru_cache(maxsize=1)
def _y_rotations() -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Eigenvectors ``(l, m, m)`` of the generators of rotations about y, and their eigenvalues ``(l, m)``."""
    count = 2 * DEGREE + 1
    vectors, values = np.zeros((DEGREE + 1, count, count), complex), np.zeros((DEGREE + 1, count))
    for degree in range(DEGREE + 1):
        m = np.arange(-degree, degree)
        up = np.sqrt(degree * (degree + 1) - m * (m + 1)) / 2j  # J_y = (J₊ − J₋) / 2i
        inside = slice(DEGREE - degree, DEGREE + degree + 1)
        values[degree, inside], vectors[degree, inside, inside] = np.linalg.eigh(np.diag(up, -1) + np.diag(-up, 1))
    return vectors, values


def _small_d(beta: NDArray[np.floating]) -> NDArray[np.complex128]:
    """d^l_mm'(β), ``(b, l, m, m)``."""
    vectors, values = _y_rotations()
    turned = vectors * np.exp(-1j * beta[:, None, None] * values)[:, :, None, :]
    return np.asarray(turned @ vectors.conj().swapaxes(1, 2))


@lru_cache(maxsize=1)
def _grid() -> tuple[NDArray[np.complex128], Float]:
    """d^l of each β of the grid, and its rotations ``(β·α·γ, 3, 3)``."""
    step = 2 * np.pi / EULER_STEPS
    turn, beta = np.arange(EULER_STEPS) * step, np.arange(EULER_STEPS // 2 + 1) * step
    b, a, c = np.meshgrid(beta, turn, turn, indexing="ij")
    matrices = Rotation.from_euler("ZYZ", np.stack([a, b, c], axis=-1).reshape(-1, 3)).as_matrix()
    return _small_d(beta), matrices


def _grid_overlaps(power: NDArray[np.complex128]) -> Float:
    """C at all rotations of the grid."""
    small_d, matrices = _grid()
    sums = np.einsum("lmk,blmk->bmk", power, small_d)
    spectrum = np.zeros((len(sums), EULER_STEPS, EULER_STEPS), complex)
    orders = np.arange(-DEGREE, DEGREE + 1)
    spectrum[:, orders[:, None], orders] = sums
    return np.fft.fft2(spectrum).real.reshape(len(matrices))


def _overlaps(power: NDArray[np.complex128], matrices: Float) -> Float:
    """C at some rotations ``(k, 3, 3)``."""
    if not len(matrices):
        return np.zeros(0)
    left = _representations(matrices)
    return np.asarray((left * power[1:]).sum(axis=(1, 2, 3)).real)


def _representations(matrices: Float) -> NDArray[np.complex128]:
    """D^l_mm' = e^(−imα) d^l_mm'(β) e^(−im'γ) of some rotations ``(k, 3, 3)`` from l = 1 on, ``(k, l, m, m)``."""
    alpha, beta, gamma = _euler_angles(matrices)
    vectors, values = _y_rotations()
    orders = np.arange(-DEGREE, DEGREE + 1)
    out = np.zeros((len(matrices), DEGREE, len(orders), len(orders)), complex)
    before, after = np.exp(-1j * alpha[:, None] * orders), np.exp(-1j * gamma[:, None] * orders)
    for degree in range(1, DEGREE + 1):
        inside = slice(DEGREE - degree, DEGREE + degree + 1)
        own, phases = vectors[degree, inside, inside], np.exp(-1j * beta[:, None] * values[degree, inside])
        left = before[:, inside, None] * own * phases[:, None, :]
        turned = (left.reshape(-1, len(own)) @ own.conj().T).reshape(left.shape)
        out[:, degree - 1, inside, inside] = turned * after[:, None, inside]
    return out


def _euler_angles(matrices: Float) -> tuple[Float, Float, Float]:
    """α, β, γ about z, y, z of some rotations ``(k, 3, 3)``; γ is 0 where only their sum or difference is determined.

    Those of scipy take four times as long for the few rotations of a grain.
    """
    across, along = np.hypot(matrices[:, 0, 2], matrices[:, 1, 2]), matrices[:, 2, 2]
    apart = across > MIN_SINE
    sign = np.where(along < 0, -1.0, 1.0)
    about_z = np.arctan2(sign * matrices[:, 1, 0], sign * matrices[:, 0, 0])
    alpha = np.where(apart, np.arctan2(matrices[:, 1, 2], matrices[:, 0, 2]), about_z)
    gamma = np.where(apart, np.arctan2(matrices[:, 2, 1], -matrices[:, 2, 0]), 0.0)
    return alpha, np.arctan2(across, along), gamma


def _peaks(likeness: Float, least: float) -> Float:
    """Rotations of the grid above ``least``, more alike than all others within a peak's width ``(k, 3, 3)``."""
    rows = np.flatnonzero(likeness > least)
    rows = rows[np.argsort(-likeness[rows], kind="stable")]
    matrices = _grid()[1][rows]
    flat = matrices.reshape(-1, 9)
    peaks: list[int] = []
    left = np.ones(len(rows), dtype=bool)
    width = 1 + 2 * np.cos(MIN_DISTANCE)
    while left.any():
        k = int(np.argmax(left))
        near = flat @ flat[k] > width
        if not near[:k].any():
            peaks.append(k)
        left &= ~near
        left[k] = False
    return matrices[peaks]


def _first_of_each(matrices: Float) -> NDArray[np.bool_]:
    """Which rotations ``(k, 3, 3)`` are far from all before them: two peaks may have been refined to one."""
    near = angles_between(matrices[:, None], matrices) < MIN_DISTANCE
    return ~np.tril(near, -1).any(axis=1)


def _refined(power: NDArray[np.complex128], matrices: Float, step: float) -> Float:
    """Rotations moved towards the maximum of C beside each, by Newton's step along three axes."""
    if not len(matrices):
        return matrices
    # D(R E) = D(R) D(E), so that C of all trials R E is a product with the same few D(E)
    at_each = _representations(matrices).swapaxes(2, 3) @ power[1:]
    trials = _trial_representations(step)
    values = (at_each.reshape(len(matrices), -1) @ trials.reshape(len(trials), -1).T).real
    slope = (values[:, 1:4] - values[:, 4:]) / 2
    curvature = np.maximum(2 * values[:, :1] - values[:, 1:4] - values[:, 4:], 1e-30)
    moves = step * np.clip(slope / curvature, -1.5, 1.5)
    return np.asarray(matrices @ Rotation.from_rotvec(moves).as_matrix())


@lru_cache(maxsize=len(REFINEMENT_STEPS))
def _trial_representations(step: float) -> NDArray[np.complex128]:
    """`_representations` of no rotation, and of one by a step to either side about each axis."""
    offsets = step * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    return _representations(Rotation.from_rotvec(offsets).as_matrix())
