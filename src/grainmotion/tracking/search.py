"""Grains that fit badly: a search over rotations for each, its neighbours held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grainmotion.project import PackedGrains, Pose, assemble, project_patches, shadows
from grainmotion.scan import Scan
from grainmotion.solve import Stopping, gauss_newton
from grainmotion.tracking.residual import StateProblem, Target, grain_residuals, misfits, noise_level

Float = NDArray[np.float64]
ANGLES_DEG = (12.0, 25.0, 45.0)
REFINED = 8  # best candidates that are refined


def lost_grains(problem: StateProblem, pose: Pose) -> NDArray[np.bool_]:
    """Grains that some view sees and that fit badly at a pose, pixel by pixel, ``(n,)``."""
    plain = StateProblem(problem.grains, problem.target.unfiltered())
    seen = plain.look(pose)
    residuals, paths = grain_residuals(plain, seen)
    return misfits(residuals, paths, noise_level(problem.target.scan)) & (seen.patches.seen.mean(axis=1) > 0)


def search_lost(problem: StateProblem, pose: Pose, coarse: Target) -> Pose | None:
    """A pose in which badly fitting grains are turned to where they fit better; None if there is none.

    Parameters
    ----------
    problem : StateProblem
        The last free problem.
    pose : Pose
        Its solution.
    coarse : Target
        The same radiographs under the widest filter, in which candidates are refined.
    """
    lost = np.nonzero(lost_grains(problem, pose))[0]
    if len(lost) == 0 or len(lost) > max(1, 0.7 * len(problem.grains)):
        return None
    coarse = replace(coarse, scan=_evened(problem, pose))
    translations, matrices = pose.translations.copy(), pose.matrices.copy()
    improved = False
    for grain in lost:
        here = Pose(translations, matrices)
        single = _alone(problem.grains, int(grain))
        own = Pose(translations[grain : grain + 1], matrices[grain : grain + 1])
        rest = _without(problem, here, single, own, coarse)
        best = _best_turn(StateProblem(single, rest), own)
        if best is not None:
            translations[grain], matrices[grain] = best.translations[0], best.matrices[0]
            improved = True
    return Pose(translations, matrices) if improved else None


def _best_turn(problem: StateProblem, own: Pose) -> Pose | None:
    """The best of many turned starts after refinement, if it beats the present one clearly."""
    starts = [own, *(Pose(own.translations, turn @ own.matrices) for turn in _turns())]
    costs = [problem.linearize(s).cost for s in starts]
    brief = Stopping(iterations=8, step=0.05)
    order = np.argsort(costs[1:])[:REFINED] + 1
    ends = [gauss_newton(problem, starts[k], brief) for k in (0, *order)]
    best = min(ends[1:], key=lambda e: e.costs[-1])
    return best.state if best.costs[-1] < 0.9 * ends[0].costs[-1] else None


def _turns() -> Float:
    """Rotation matrices by each of `ANGLES_DEG` about 14 axes (faces and corners of a cube, both ways)."""
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3)
    axes = np.concatenate([faces, corners])
    vectors = np.concatenate([np.deg2rad(a) * axes for a in ANGLES_DEG])
    return Rotation.from_rotvec(vectors).as_matrix()


def _evened(problem: StateProblem, pose: Pose) -> Scan:
    """The radiographs without the gain and offset that fit at a pose, so that one grain can be fitted alone."""
    seen, scan = problem.look(pose), problem.target.scan
    if not 0.5 < seen.gain < 2:  # no beam drifts so far: what was fitted is not a gain
        return scan
    return Scan((scan.line_integrals - seen.offset) / seen.gain, scan.geometry, scan.valid)


def _alone(grains: PackedGrains, k: int) -> PackedGrains:
    size = int(np.prod(grains.shapes[k]))
    start = int(grains.starts[k])
    one = slice(k, k + 1)
    return PackedGrains(
        grains.images[start : start + size], np.zeros(1, np.int64), grains.shapes[one], grains.corners[one],
        grains.centers[one], grains.hulls[one], grains.radii[one], grains.voxel_size,
    )  # fmt: skip


def _without(problem: StateProblem, pose: Pose, single: PackedGrains, own: Pose, coarse: Target) -> Target:
    """What is left for one grain to explain: the other grains count as fixed."""
    geometry, projector = coarse.scan.geometry, coarse.projector
    images = []
    for grains, at in ((problem.grains, pose), (single, own)):
        patches = shadows(grains, at, geometry)
        images.append(assemble(project_patches(grains, at, geometry, patches, projector), patches, geometry))
    return replace(coarse, fixed=coarse.fixed + images[0] - images[1], gain=False)
