"""One damped step of tracking by four solvers, on real normal matrices: where the switch between them lies.

    python -m validation.benchmarks.normal_solvers [--sizes 15 60 100 200 400 1000]

Dense Cholesky, sparse Cholesky (SuperLU in symmetric mode, ordered by minimum degree: its fill is what any ordering
of such a matrix has; CHOLMOD's as well if `cvxopt` is there), conjugate gradients on assembled blocks, and the same
on patches, no block ever sample.  Samples are those of `crowd`; CPU time holds the assembly.  Writes
``validation/benchmarks/results/normal_solvers.md``; ends with code 1 if steps differ.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import splu

from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.solvers.block_cg import conjugate_gradients, diagonal_blocks
from validation.benchmarks.crowd import VOXEL, crowd
from validation.benchmarks.peers.environment import machine

RESULT = Path(__file__).parent / "results" / "normal_solvers.md"
SIZES = (15, 60, 100, 200, 400, 1000)
SIGMAS = (2.1, 0.7)  # of the first and the last free stage, for stones of 14 voxels
DAMPING, CG_TOLERANCE = 1e-4, 1e-2
DENSE_TO, SPARSE_TO = 1000, 400
Float = NDArray[np.float64]


def timed(run: Callable[[], Float]) -> tuple[float, Float]:
    """CPU seconds, the least of two, and the step."""
    best, found = np.inf, np.zeros(0)
    for _ in range(2):
        begin = time.process_time()
        found = run()
        best = min(best, time.process_time() - begin)
    return best, found


def by_cholmod(matrix: sparse.csc_array, b: Float) -> Float | None:
    """The step by CHOLMOD, if there is one."""
    try:
        from cvxopt import cholmod, spmatrix
        from cvxopt import matrix as dense
    except ImportError:
        return None
    low = sparse.coo_array(sparse.tril(matrix))
    x = dense(b)
    cholmod.linsolve(spmatrix(low.data, low.row.astype(int), low.col.astype(int), matrix.shape), x)
    return np.array(x).ravel()


def measure(n: int, sigma: float) -> list[str]:
    """A row of the table, and whether all steps agree (in its last cell)."""
    sample = crowd(n)
    rng = np.random.default_rng(0)
    shifts = sample.truth.translations + 0.3 * VOXEL * rng.standard_normal((n, 3))
    target = Target(sample.scan, np.zeros_like(sample.scan.line_integrals), "trilinear", sigma)
    seen = StateProblem(GrainArrays.of(sample.grains), target).evaluate_with_derivatives(
        Pose(shifts, sample.truth.matrices)
    )
    b = seen.jacobian.gradient(seen.residual).ravel()

    def lifted() -> tuple[sparse.bsr_array, Float]:
        matrix = normal_matrix(seen.jacobian)
        return matrix, DAMPING * matrix.diagonal()

    def dense() -> Float:
        matrix, more = lifted()
        whole = matrix.toarray()
        whole[np.diag_indices_from(whole)] += more
        return cho_solve(cho_factor(whole, overwrite_a=True, check_finite=False), b, check_finite=False)

    def factored() -> Float:
        matrix, more = lifted()
        options = {"SymmetricMode": True}
        lu = splu(
            sparse.csc_array(sparse.csc_array(matrix) + sparse.diags_array(more)), "MMD_AT_PLUS_A", 0.0, options=options
        )
        return lu.solve(b)

    def assembled(accuracy: float = CG_TOLERANCE) -> Float:
        matrix, more = lifted()
        whole, blocks = sparse.csr_array(matrix) + sparse.diags_array(more), diagonal_blocks(matrix)
        blocks = blocks + more.reshape(n, 6, 1) * np.eye(6)
        return conjugate_gradients(lambda x: whole @ x, blocks, b, accuracy)

    products = 0

    def product(accuracy: float = CG_TOLERANCE) -> Float:
        nonlocal products
        products = 0
        matrix = PatchNormalMatrix(seen.jacobian)
        more = DAMPING * matrix.diagonal()

        def apply(x: Float) -> Float:
            nonlocal products
            products += 1
            return matrix @ x + more[:, None] * x

        return conjugate_gradients(apply, matrix.blocks() + more.reshape(n, 6, 1) * np.eye(6), b, accuracy)

    matrix, more = lifted()
    shifted = sparse.csc_array(sparse.csc_array(matrix) + sparse.diags_array(more))
    times = [timed(dense)[0] if n <= DENSE_TO else np.nan, timed(factored)[0] if n <= SPARSE_TO else np.nan]
    begin = time.process_time()
    cholmod = by_cholmod(shifted, b) if n <= DENSE_TO else None
    times += [time.process_time() - begin if cholmod is not None else np.nan, timed(assembled)[0], timed(product)[0]]
    exact, other = product(1e-9), assembled(1e-9)
    agree = np.abs(exact - other).max() < 1e-4 * np.abs(exact).max()
    product()
    size = matrix.data.nbytes, np.asarray(seen.jacobian.derivatives).nbytes
    cells = ["–" if np.isnan(t) else f"{1e3 * t / n:.2f}" for t in times]
    return [
        f"{n:,}", f"{sigma:g}", f"{len(matrix.indices) / n:.0f}", *cells, str(products), f"{size[0] / 1e3 / n:.0f}",
        f"{size[1] / 1e3 / n:.0f}", "yes" if agree else "NO",
    ]  # fmt: skip


def main() -> int:
    """Measure all sizes and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES))
    options = parser.parse_args()
    measure(15, 0.7)  # compiles
    rows = [measure(n, sigma) for sigma in SIGMAS for n in options.sizes]
    for row in rows:
        print(row, flush=True)
    text = [
        "# Solvers of the normal equations",
        "",
        "CPU ms a grain for one damped step, assembly included; stones about 14 voxels across, 4 views (`crowd.py`).",
        f"Conjugate gradients to a relative residual of {CG_TOLERANCE:g}, preconditioned by 6×6 blocks.",
        "",
        "| grains | σ, pixels | blocks a grain | dense Cholesky | sparse (SuperLU) | CHOLMOD, solve alone | CG, blocks "
        "| CG, patches | products | blocks, kB a grain | patches, kB a grain | steps agree |",
        "|" + "---|" * 12,
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
        f"{machine()}.  Made by `python -m validation.benchmarks.normal_solvers "
        f"--sizes {' '.join(map(str, options.sizes))}`.",
        "",
    ]
    RESULT.write_text("\n".join(text))
    print(RESULT.read_text())
    return 0 if all(row[-1] == "yes" for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
