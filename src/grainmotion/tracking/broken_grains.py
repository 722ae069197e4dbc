"""Grains that broke in two: mass that is there, in another shape.

A broken grain disturbs its neighbours, and all others of a small sample.  Each grain that fits badly is cut in trial by
planes of many directions through its centre, and the halves are fitted as two bodies beside all others, from where the
census puts the grain.  Cutting the grain that broke leaves a third to an eighth of the residual; cutting another
leaves nine tenths (decision 0035).  The best cut is tilted and shifted a little, and the sample with two bodies in
place of the grain is fitted from there.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.state_fit import PieceMotion
from grainmotion.model.volume import Volume
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays, ball_directions
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.rotations import rotation_vector, skew_matrix
from grainmotion.solvers.gauss_newton import gauss_newton
from grainmotion.solvers.stopping import Stopping
from grainmotion.tracking.attempt import Approach, Attempt, Job, approach, finish
from grainmotion.tracking.missing_grains import registered
from grainmotion.tracking.presence import take_census

FEW_NORMALS, MANY_NORMALS = ball_directions()[:64:9], ball_directions()[:64:3]
"""Normals of trial cuts: to find the grain that broke, and where."""
CUT_FILTERS = (12.0, 6.0)
"""Filters, as in `TrackSettings`, under which cuts are compared."""
CUT_GRAIN_PIXELS = 8.0
"""Least coarse pixels across a grain there."""
CUT_STOPPING = Stopping(iterations=6, step=0.05, decrease=0.05)
"""For the bodies of a cut sample."""
FINE_CUT_FILTERS, CHANGES = (12.0, 6.0, 2.0), (0.2, 0.1, 0.05)
"""Filters under which changes of the best cut are compared; changes of its normal, and of its distance from the centre
in radii."""
MAX_CUT_IN_TRIAL, MAX_BROKEN, MAX_GRAINS_CUT = 6, 4, 60
"""Grains cut in trial and grains that may have broken, at most; in samples of so many grains at most."""
MAX_LEFT_RESIDUAL = 0.6
"""Share of the residual that a right cut leaves at most: 0.12 to 0.35 for grains that broke, 0.75 to 1 for others (six
stones, one broken into halves 6 voxels apart and turned by 15 degrees, 4 views)."""
MAX_CENSUS_RESIDUAL = 0.15
"""Residual of the census above which the radiographs are not those of this sample: 0.06 to 0.09 with one of six grains
broken."""


@dataclass(frozen=True, eq=False)
class _Cut:
    """A sample with halves in place of grains, where they are, and the residual under the last of some filters.

    ``whole`` holds, by the row of each half in ``grains``, the row of its grain in the reference.
    """

    grains: GrainSet
    pose: Pose
    whole: dict[int, int]
    rows: NDArray[np.int64]
    residual: float = np.inf


def with_broken(job: Job, near: Approach, first: Attempt) -> Attempt | None:
    """The motions beside the halves of grains that broke; None if no cut explains what fits badly."""
    with suppress(np.linalg.LinAlgError):  # ends the trials, not the run
        return _with_halves(job, near, first)
    return None


def _with_halves(job: Job, near: Approach, first: Attempt) -> Attempt | None:
    """The same; equations that cannot be solved are an error."""
    bad = np.flatnonzero(first.motions.statuses == Status.NOT_CONVERGED.value)
    bad = bad[np.argsort(-first.motions.residuals[bad])][:MAX_CUT_IN_TRIAL]
    if not len(bad) or len(job.grains) > MAX_GRAINS_CUT or not job.settings.search:
        return None
    census = take_census(near.fit, near.start, near.fields)
    if census.residual > MAX_CENSUS_RESIDUAL or not census.present.all():
        return None
    cut = _Cut(job.grains, census.pose, {}, np.arange(len(job.grains)))
    uncut = _fitted(job, cut, CUT_FILTERS[:1]).residual
    for _ in range(MAX_BROKEN):
        better = _better_cut(job, cut, bad, uncut)
        if better is None:
            break
        cut, uncut = better, _fitted(job, better, CUT_FILTERS[:1]).residual
    if not cut.whole:
        return None
    start = replace(
        Motions.identity(cut.grains.labels, cut.grains.centers),
        translations=cut.pose.translations,
        rotations=rotation_vector(cut.pose.matrices),
    )
    halved = replace(job, grains=cut.grains, start=start, settings=replace(job.settings, fields=False))
    found = finish(halved, approach(halved))
    motions = _of_whole_grains(job.grains, cut, found.motions)
    gained = registered(motions).sum() + (motions.statuses == Status.BROKEN.value).sum()
    if gained <= registered(first.motions).sum():
        return None
    return Attempt(motions, np.ones(len(motions)), new=found.new, pieces=_image_of_pieces(halved, cut, found.motions))


def _image_of_pieces(job: Job, cut: _Cut, found: Motions) -> Image:
    """Line integrals of all pieces ``(views, rows, columns)``."""
    rows, geometry = sorted(cut.whole), job.scan.geometry
    pieces = GrainArrays.of(replace(cut.grains, grains=tuple(cut.grains.grains[k] for k in rows)), fine=True)
    pose = Pose(np.nan_to_num(found.translations[rows]), np.nan_to_num(found.matrices[rows]))
    patches = footprint_patches(pieces, pose, geometry)
    return assemble(project_patches(pieces, pose, geometry, patches, job.settings.projector), patches, geometry)


def _better_cut(job: Job, cut: _Cut, bad: NDArray[np.int64], uncut: float) -> _Cut | None:
    """The cut of one more grain that explains most; None if none does."""
    rows = [k for k, row in enumerate(cut.rows) if row in bad and k not in cut.whole]
    coarse = [
        (_fitted(job, _halved(cut, k, normal, 0.0), CUT_FILTERS[:1]).residual, k)
        for k in rows
        for normal in FEW_NORMALS
    ]
    if not coarse or min(coarse)[0] > MAX_LEFT_RESIDUAL * uncut:
        return None
    k = min(coarse)[1]
    trials = [(_fitted(job, _halved(cut, k, normal, 0.0), CUT_FILTERS), normal) for normal in MANY_NORMALS]
    normal = min(trials, key=lambda trial: trial[0].residual)[1]
    return _refined_cut(job, cut, k, normal)


def _refined_cut(job: Job, cut: _Cut, k: int, normal: Float) -> _Cut:
    """The best of cuts of grain ``k`` by planes near the one through its centre with this normal."""
    voxels = float((cut.grains.grains[k].volume.array > 0).sum())
    radius = float(np.cbrt(3 * voxels / (4 * np.pi))) * cut.grains.voxel_size
    shift, best = 0.0, _fitted(job, _halved(cut, k, normal, 0.0), FINE_CUT_FILTERS)
    for size in CHANGES:
        for change in np.vstack([np.eye(3), -np.eye(3)]) * size:
            across = np.linalg.svd(normal[None])[2][1:]
            tilted = normal + change[:2] @ across
            tilted, moved = tilted / np.linalg.norm(tilted), shift + change[2] * radius
            trial = _fitted(job, _halved(cut, k, tilted, moved), FINE_CUT_FILTERS)
            if trial.residual < best.residual:
                best, normal, shift = trial, tilted, moved
    return best


def _fitted(job: Job, cut: _Cut, filters: tuple[float, ...]) -> _Cut:
    """All bodies of a cut sample free, filter by filter."""
    fit, pose, residual = replace(job, grains=cut.grains, progress=None).fit(), cut.pose, np.inf
    for width in filters:
        problem = StateProblem(*fit.level(width, least=CUT_GRAIN_PIXELS))
        solution = gauss_newton(problem, pose, CUT_STOPPING)
        pose, measured = solution.state, problem.target.measured.astype(float)
        residual = float(np.sqrt(2 * solution.costs[-1] / max(float(np.vdot(measured, measured)), 1e-30)))
    return replace(cut, pose=pose, residual=residual)


def _halved(cut: _Cut, k: int, normal: Float, shift: float) -> _Cut:
    """The sample with the halves of grain ``k`` at its end, where the whole was."""
    whole, others = cut.grains.grains[k], [i for i in range(len(cut.grains)) if i != k]
    top = int(cut.grains.labels.max())
    pieces = [_half(whole, side * normal, side * shift, top + 1 + i) for i, side in enumerate((1, -1))]
    turned = [(cut.pose.matrices[k] - np.eye(3)) @ (piece.center - whole.center) for piece in pieces]
    places = [cut.pose.translations[k] + offset for offset in turned]
    pose = cut.pose.moved(np.vstack([cut.pose.translations[others], *places]), cut.pose.matrices[[*others, k, k]])
    rows = np.append(cut.rows[others], [cut.rows[k]] * 2)
    halves = {others.index(i): row for i, row in cut.whole.items()}
    halves |= {len(others) + i: int(cut.rows[k]) for i in range(2)}
    grains = replace(cut.grains, grains=(*(cut.grains.grains[i] for i in others), *pieces))
    return _Cut(grains, pose, halves, rows)


def _half(grain: Grain, normal: Float, shift: float, label: int) -> Grain:
    """The part of a grain where (x − c) · normal > shift, mm."""

    def part(volume: Volume) -> tuple[Volume, Float]:
        axes = [
            volume.origin[j] + volume.voxel_size * np.arange(volume.array.shape[2 - j]) - grain.center[j]
            for j in range(3)
        ]
        heights = axes[2][:, None, None] * normal[2] + axes[1][:, None] * normal[1] + axes[0] * normal[0] - shift
        array = volume.array * np.clip(0.5 + heights / volume.voxel_size, 0, 1).astype(volume.array.dtype)
        mass = max(float(array.sum(dtype=float)), 1e-30)
        marginals = [array.sum(axis=tuple({0, 1, 2} - {2 - j}), dtype=float) for j in range(3)]
        center = np.array([m @ a / mass for m, a in zip(marginals, axes, strict=True)]) + grain.center
        return replace(volume, array=array), center

    volume, center = part(grain.coarse_volume)
    fine = None if grain.fine_volume is None else part(grain.fine_volume)[0]
    return Grain(label, volume, center, grain.touches_border, fine)


def _of_whole_grains(grains: GrainSet, cut: _Cut, found: Motions) -> Motions:
    """A row for each grain of the reference: of a broken one that of its larger piece, carried to its centre."""
    motions = found.for_grains(grains.labels, grains.centers)
    statuses, reasons, parts = motions.statuses.copy(), list(motions.reasons), list[PieceMotion]()
    masses = np.array([float(grain.volume.array.sum(dtype=float)) for grain in cut.grains.grains])
    for row in sorted(set(cut.whole.values())):
        pieces = sorted((i for i, whole in cut.whole.items() if whole == row), key=lambda i: -masses[i])
        shares, larger = masses[pieces] / masses[pieces].sum(), pieces[0]
        arm = grains.centers[row] - cut.grains.centers[larger]
        matrix = found.matrices[larger]
        carried = np.eye(6)
        carried[:3, 3:] = -skew_matrix((matrix @ arm)[None])[0]
        motions.translations[row] = found.translations[larger] + (matrix - np.eye(3)) @ arm
        motions.rotations[row] = found.rotations[larger]
        motions.covariances[row] = carried @ found.covariances[larger] @ carried.T
        motions.residuals[row] = found.residuals[larger]
        motions.iterations[row] = found.iterations[larger]
        fits = np.isin(found.statuses[pieces], [Status.CONVERGED.value, Status.POORLY_DETERMINED.value]).all()
        statuses[row] = (Status.BROKEN if fits else Status.NOT_CONVERGED).value
        label = int(grains.labels[row])
        parts += [
            _piece(label, number, float(share), found, i)
            for number, (share, i) in enumerate(zip(shares, pieces, strict=True), start=1)
        ]
        told = [_told(share, found, i) for share, i in zip(shares, pieces, strict=True)]
        fact = (
            "broken in two, which fit the radiographs" if fits else "perhaps broken, but its two pieces do not both fit"
        )
        reasons[row] = f"{fact}: {', '.join(told)}; the motion given is the larger's"
    fit = replace(motions.fit, pieces=tuple(parts))
    return replace(motions, statuses=statuses, reasons=tuple(reasons), fit=fit)


def _piece(label: int, number: int, share: float, found: Motions, i: int) -> PieceMotion:
    """The motion of a piece, row ``i`` of ``found``."""
    motion = found.centers[i], found.translations[i], found.rotations[i], found.covariances[i]
    return PieceMotion(label, number, share, *motion, status=str(found.statuses[i]))


def _told(share: float, found: Motions, i: int) -> str:
    """The motion of a piece in words."""
    shift = " ".join(f"{value:.3g}" for value in found.translations[i])
    turn = " ".join(f"{value:.3g}" for value in np.rad2deg(found.rotations[i]))
    return f"{share:.0%} of it moved by ({shift}) mm and ({turn}) degrees"
