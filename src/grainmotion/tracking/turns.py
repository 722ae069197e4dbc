"""Which turns of a grain the radiographs confirm.

A ball may turn as it likes, yet derivatives do not say so: its voxel image is never quite round, and the
pattern of its voxels (partial volumes, noise of the reconstruction) turns with it in the simulation.  H
then holds information about rotations that the radiographs do not hold, and its covariance is a fraction
of a degree where anything goes.  So each grain is turned by ±θ, its rim by four voxels, about the principal
axes of its own rotations in H.  With ΔP the simulated change, translations fitted out, and r the residual,

    D = ‖ΔP‖²,    confirmed = (‖r − ΔP‖² − ‖r‖²) / D = 1 − 2 r·ΔP / D,    coherent = D / (θ² H).

``confirmed`` is the share of the change that the radiographs contradict, as they should: 1 for a shape that
they hold too, 0 for a pattern that only the reference has.  ``coherent`` is 1 for a quadratic valley and
falls to 0 for a pattern finer than the turn.  Gravel has 0.9 to 1.1 and 0.5 to 1, balls −0.2 to 0.5 and
0.02 to 0.1 (45 and 20 voxels across, 4 views).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from grainmotion import motion
from grainmotion.kernels import normal
from grainmotion.packed import Image, PackedGrains, Pose
from grainmotion.project import Patches, differentiate_patches, project_patches, shadows
from grainmotion.tracking.cast import Walk
from grainmotion.tracking.residual import Seen, StateProblem

Float = NDArray[np.float64]
RIM = 4.0  # voxels that the rim of a grain is carried
LARGEST = 0.5  # radians
ANY_TURN = np.pi**2 / 3  # variance of an angle of which nothing is known


def unconfirmed(problem: StateProblem, pose: Pose, seen: Seen) -> Float:
    """Covariance ``(n, 3, 3)``, rad², of the turns that the radiographs do not confirm; zero where they do."""
    target = problem.target
    test = partial(_unconfirmed, walk=target.walk(pose), kernel=target.kernel)
    return target.crew.each(problem.grains, pose, test, seen.factor, seen.residual)


def _unconfirmed(grains: PackedGrains, pose: Pose, factor: Image, residual: Image, walk: Walk, kernel: Image) -> Float:
    """As `unconfirmed`, from what takes derivatives to weighted ones, and the residual."""
    geometry, projector = walk.geometry, walk.projector
    angles = np.minimum(RIM * grains.unit / grains.radii, LARGEST)
    patches = shadows(_swollen(grains, angles), pose, geometry, margin=walk.margin)
    values, slopes = differentiate_patches(grains, pose, geometry, patches, projector)
    normal.filter_patches(slopes, patches.boxes, patches.offsets, factor, kernel)
    information, axes = np.linalg.eigh(_rotations(_products(slopes, slopes, patches, len(grains))))
    changes = np.empty_like(slopes)
    for axis in range(3):
        for sign in (0, 1):
            turns = motion.exp((1 - 2 * sign) * angles[:, None] * axes[:, :, axis])
            turned = Pose(pose.translations, turns @ pose.matrices)
            moved = project_patches(grains, turned, geometry, patches, projector)
            changes[2 * axis + sign] = moved - values
    normal.filter_patches(changes, patches.boxes, patches.offsets, factor, kernel)
    _fit_out(changes, slopes, patches, len(grains))
    both = (len(grains), 3, 2)
    squares = np.diagonal(_products(changes, changes, patches, len(grains)), axis1=1, axis2=2).reshape(both).sum(2)
    against = np.zeros((len(patches.boxes), 6))
    normal.gradients(changes, patches.boxes, patches.offsets, residual, against)
    dots = np.zeros((len(grains), 6))
    np.add.at(dots, patches.boxes[:, 0], against)
    with np.errstate(divide="ignore", invalid="ignore"):
        confirmed = 1 - 2 * dots.reshape(both).sum(2) / squares
        coherent = squares / (2 * angles[:, None] ** 2 * information)
    loose = (confirmed < 0.5) | ((confirmed < 0.9) & (coherent < 0.3))
    return ANY_TURN * np.einsum("nia,na,nja->nij", axes, loose.astype(float), axes)


def _swollen(grains: PackedGrains, angles: Float) -> PackedGrains:
    """The same grains with hulls that hold all their turned ones."""
    reach = np.linalg.norm(grains.hulls, axis=2, keepdims=True)
    out = angles[:, None, None] * reach.max(axis=1, keepdims=True)
    return replace(grains, hulls=grains.hulls * (1 + out / np.maximum(reach, grains.unit)))


def _products(left: Image, right: Image, patches: Patches, n: int) -> Float:
    """Sums over each grain's own patches of left · rightᵀ, ``(n, 6, 6)``."""
    out = np.zeros((n, len(left), len(right)))
    for p, grain in enumerate(patches.boxes[:, 0]):
        mine = slice(patches.offsets[p], patches.offsets[p + 1])
        out[grain] += left[:, mine] @ right[:, mine].T
    return out


def _rotations(matrices: Float) -> Float:
    """What is left of each grain's 6×6 block for rotations once its translations are free, ``(n, 3, 3)``."""
    across = np.linalg.pinv(matrices[:, :3, :3], hermitian=True) @ matrices[:, :3, 3:]
    left = matrices[:, 3:, 3:] - matrices[:, 3:, :3] @ across
    return (left + left.transpose(0, 2, 1)) / 2


def _fit_out(changes: Image, slopes: Image, patches: Patches, n: int) -> None:
    """Take from the changes, in place, what translations of the grain would do."""
    own = _products(slopes, slopes, patches, n)[:, :3, :3]
    shifts = np.linalg.pinv(own, hermitian=True) @ _products(slopes, changes, patches, n)[:, :3]
    for p, grain in enumerate(patches.boxes[:, 0]):
        mine = slice(patches.offsets[p], patches.offsets[p + 1])
        changes[:, mine] -= shifts[grain].T.astype(slopes.dtype) @ slopes[:3, mine]
