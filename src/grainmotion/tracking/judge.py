"""What became of each grain: covariance, residual, status and its sentence.

Covariance: the estimate is x = J⁺ F b with F the last filter, so photon noise of variance s² carried
through it gives  s² H⁻¹ (F J)ᵀ(F J) H⁻¹  with J the filtered derivatives and H = JᵀJ, coupling between
grains included.  s² is the residual's own variance over the grain's shadow, so that it holds model error
too, and is raised by the factor by which filtered residuals exceed what white noise would leave.  Turns
that the radiographs do not confirm (`turns`) are added as unknown.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion import motion
from grainmotion.grains import GrainSet
from grainmotion.kernels import normal
from grainmotion.motions import Motions, StateFit, Status
from grainmotion.packed import OUT_OF_PLANE, Pose, planar
from grainmotion.solve import DENSE_UP_TO, Solution
from grainmotion.tracking.misfit import grain_residuals, misfits, noise_level
from grainmotion.tracking.residual import Seen, StateProblem, normal_matrix
from grainmotion.tracking.search import Found
from grainmotion.tracking.turns import unconfirmed

Float = NDArray[np.float64]
ROUNDING = 1e-6  # of the normal matrices, which are summed from single precision
AMBIGUOUS = "another search put it elsewhere, and neither fit is perfect; take more views, or give a nearer start"
LEAST_ERROR = 2e-3  # of a grain's line integrals: no radiograph and no voxel image is better than that
SEEN_ENOUGH = 0.6  # share of a grain's shadows on the panel below which it has left the field


def judge(
    grains: GrainSet,
    found: Found,
    limits: tuple[float, float],
    costs: tuple[tuple[str, float], ...],
) -> Motions:
    """Turn what was found into a table; ``limits`` are the largest sd of u (mm) and of ω (rad) to accept."""
    problem, solution = found.problem, found.solution
    seen = problem.look(solution.state)
    plain = StateProblem(problem.grains, problem.target.unfiltered())
    raw = plain.look(solution.state)
    residuals, paths = grain_residuals(plain, raw)
    covariances = _covariances(problem, seen, raw, np.fmax(residuals, LEAST_ERROR * paths))
    covariances[:, 3:, 3:] += unconfirmed(problem, solution.state, seen)
    if planar(problem.grains, problem.target.scan.geometry):
        covariances[:, OUT_OF_PLANE, :] = covariances[:, :, OUT_OF_PLANE] = 0
    n = len(grains)
    statuses, reasons = np.full(n, Status.CONVERGED.value, dtype="<U20"), [""] * n
    lost = misfits(residuals, paths, noise_level(problem.target.scan))
    coverage = raw.patches.seen.mean(axis=1)
    moving = _still_moving(problem, solution)
    for k in range(n):
        verdict = _verdict(
            coverage[k], covariances[k], limits, bool(lost[k]), bool(moving[k]), (residuals[k], paths[k])
        )
        if verdict is None and found.doubtful[k]:
            verdict = Status.NOT_CONVERGED.value, AMBIGUOUS
        if verdict is not None:
            statuses[k], reasons[k] = verdict
    unknown = np.isin(statuses, [Status.LEFT_FIELD.value, Status.NOT_FITTED.value])
    translations, rotations = solution.state.translations.copy(), motion.log(solution.state.matrices)
    translations[unknown] = rotations[unknown] = np.nan
    covariances[unknown] = np.nan
    iterations = np.full(n, len(costs), dtype=np.int64)
    fit = StateFit(raw.gain, raw.offset, costs)
    return Motions(
        grains.labels, grains.centers, translations, rotations, covariances, statuses, residuals, iterations,
        tuple(reasons), fit,
    )  # fmt: skip


def _verdict(
    coverage: float,
    covariance: Float,
    limits: tuple[float, float],
    lost: bool,
    moving: bool,
    fit: tuple[float, float],
) -> tuple[str, str] | None:
    """Status and sentence of a grain that did not simply converge."""
    if coverage == 0 or not np.isfinite(fit[1]):
        return (
            Status.NOT_FITTED.value,
            "no view sees it; check its place, or give views or a start that see it",
        )
    if coverage < SEEN_ENOUGH:
        return (
            Status.LEFT_FIELD.value,
            f"only {coverage:.0%} of its shadows fall on the panel; take views that hold it, or leave it out",
        )
    if lost:
        return (
            Status.NOT_CONVERGED.value,
            f"its residual {fit[0]:.3g} is too large for its line integrals of {fit[1]:.3g}: wrong minimum, broken or "
            "badly segmented grain; give a nearer start, more views, or check its label",
        )
    sd = np.sqrt(np.diagonal(covariance))
    bad_u, bad_w = ~(sd[:3] <= limits[0]), ~(sd[3:] <= limits[1])
    if bad_u.any() or bad_w.any():
        names = [f"translation along {a}" for a, b in zip("xyz", bad_u) if b]
        names += [f"rotation about {a}" for a, b in zip("xyz", bad_w) if b]
        cause = "the views, or a shape as round as this, do not tell" if bad_w.any() else "the views do not tell"
        return (
            Status.POORLY_DETERMINED.value,
            f"poorly determined: {', '.join(names)}; {cause}, take more views or other angles, or use the rest alone",
        )
    if moving:
        return Status.NOT_CONVERGED.value, "still moving when iterations ran out; raise track.iterations"
    return None


def _still_moving(problem: StateProblem, solution: Solution[Pose]) -> NDArray[np.bool_]:
    """Grains that the last step still moved by more than a tenth of a voxel, if the solver did not settle."""
    each = solution.last_step.reshape(-1, 6)
    if solution.settled:
        return np.zeros(len(each), dtype=bool)
    moved = np.linalg.norm(each[:, :3], axis=1) + np.linalg.norm(each[:, 3:], axis=1) * problem.grains.radii
    return moved > 0.1 * problem.grains.voxel_size


def _covariances(problem: StateProblem, seen: Seen, raw: Seen, residuals: Float) -> Float:
    """Covariances ``(n, 6, 6)`` of (u, δ)."""
    target, n = problem.target, len(problem.grains)
    once = normal_matrix(seen.derivatives, seen.patches, n)
    again = seen.derivatives.copy()
    normal.filter_patches(again, seen.patches.boxes, seen.patches.offsets, np.ones_like(target.valid), target.weights)
    twice = normal_matrix(again, seen.patches, n)
    filtered, _ = grain_residuals(problem, seen)
    kernel = np.concatenate([target.weights[:0:-1], target.weights]).astype(float)
    white = float((kernel**2).sum())  # variance left of white noise by one pass along each of two axes
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = np.fmax(1.0, (filtered / (residuals * white)) ** 2)
        variances = residuals**2 * excess / max(abs(raw.gain), 1e-3) ** 2
    return _sandwich(once, twice) * variances[:, None, None]


def _sandwich(once: sparse.bsr_array, twice: sparse.bsr_array) -> Float:
    """Diagonal blocks of H⁻¹ M H⁻¹; for many grains each from its own neighbourhood alone."""
    n = once.shape[0] // 6
    out = np.empty((n, 6, 6))
    if 6 * n <= DENSE_UP_TO:
        neighbourhoods = [np.arange(n)]
    else:
        neighbourhoods = [
            np.r_[i, np.setdiff1d(once.indices[once.indptr[i] : once.indptr[i + 1]], i)] for i in range(n)
        ]
    h, m = sparse.csr_array(once), sparse.csr_array(twice)
    for i, near in enumerate(neighbourhoods):
        rows = (6 * near[:, None] + np.arange(6)).ravel()
        inverse = _regular_inverse(h[rows][:, rows].toarray())
        moments = m[rows][:, rows].toarray()
        moments[np.diag_indices_from(moments)] *= 1 + ROUNDING  # else unseen directions may get variances below 0
        full = inverse @ moments @ inverse
        if len(neighbourhoods) == 1:
            for k in range(n):
                out[k] = full[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        else:
            out[i] = full[:6, :6]
    return out


def _regular_inverse(matrix: Float) -> Float:
    """Inverse after scaling to unit diagonal, unseen directions left with a huge variance, not an error."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-30))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, ROUNDING)
    return (vectors / values) @ vectors.T / np.outer(scale, scale)
