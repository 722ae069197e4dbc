"""Exchange with spam (https://www.spam-project.dev): the ``…-ddic.tsv`` of its discrete correlation.

One row a label, from 0 (background) to the largest, so that row number and label agree, tab-separated:

    Label  Zpos Ypos Xpos  Zdisp Ydisp Xdisp  Fzz Fzy Fzx Fyz Fyy Fyx Fxz Fxy Fxx
    PSCC  error  iterations  returnStatus  deltaPhiNorm  LabelDilate

Positions and displacements are in voxels of the labelled image (voxel [0, 0, 0] is centred at 0), in z y x
order; Φ = [F | disp] carries the reference to the current state about the label's own position.  Hence,
with h the voxel size and o the position of voxel [0, 0, 0] in the sample frame,

    pos = (c − o)/h,    disp = u/h,    F = Ω,    each with its x y z components written in z y x order.

spam 0.9.1 writes the labels' centres of mass, but its Φ is about the middle of each label's bounding box: for
grains that rotate, displacements that it measured are off by (Ω − 1) times the vector between the two
(`validation/benchmarks/full_scan.py`).

Reversing the order of the axes mirrors the frame, so the rotation vector that spam derives from F,
in z y x order, is **minus** the reversed rotation vector of grainmotion; F itself needs no sign.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume
from grainmotion.rotations import recenter, rotation_vector

POSITION = ("Zpos", "Ypos", "Xpos")
DISPLACEMENT = ("Zdisp", "Ydisp", "Xdisp")
GRADIENT = ("Fzz", "Fzy", "Fzx", "Fyz", "Fyy", "Fyx", "Fxz", "Fxy", "Fxx")
QUALITY = ("PSCC", "error", "iterations", "returnStatus", "deltaPhiNorm", "LabelDilate")
DDIC_COLUMNS = ("Label", *POSITION, *DISPLACEMENT, *GRADIENT, *QUALITY)

RETURN_STATUS: dict[str, int] = {
    Status.CONVERGED.value: 2,
    Status.POORLY_DETERMINED.value: 1,
    Status.NOT_CONVERGED.value: 1,
    Status.LEFT_FIELD.value: -7,
    Status.NOT_FITTED.value: 0,
    Status.AMBIGUOUS.value: 1,
    Status.ABSENT.value: -7,
    Status.CUT.value: 1,
    Status.BROKEN.value: 1,
    Status.DEFORMED.value: 1,
}
"""spam's ``returnStatus`` of each status: 2 converged, 1 not converged, 0 not correlated, -7 no grain to correlate."""

MIN_STRETCH = 0.1
"""Smallest stretch of a gradient; one that flattens a grain more has no rotation."""
MAX_STRAIN = 0.2
"""Largest strain of a grain that is still taken for a rigid motion; grains of stone strain by less than 0.01."""


def write_ddic_tsv(path: str | Path, motions: Motions, grid: Volume, labels: NDArray[np.integer] | None = None) -> None:
    """Write motions as spam's discrete-correlation TSV, in voxels of ``grid``, the reference volume.

    With ``labels`` (nz, ny, nx) each motion is stated about the label's own centre of mass (all voxels with equal
    weight), which spam-ddic requires within 0.1 voxel when it starts from this file; without them, about the
    attenuation-weighted centres of ``motions``.

    ``error`` is the residual in line-integral units, which is not spam's measure; ``PSCC`` (spam's correlation
    coefficient), ``deltaPhiNorm`` and ``LabelDilate`` are 0.  Labels without a grain, and grains without a motion, get
    NaN displacements, as in spam.
    """
    if len(motions) and motions.labels.min() < 1:
        raise InputError("motions.label", f"label {motions.labels.min()}", "spam counts grains from 1; relabel them")
    centers, translations, matrices = motions.centers, motions.translations, motions.gradients
    if labels is not None:
        centers = _label_centers(labels, motions.labels, grid)
        translations = recenter(matrices, translations, motions.centers, centers)

    rows = int(motions.labels.max(initial=0)) + 1
    table = pd.DataFrame(np.zeros((rows, len(DDIC_COLUMNS))), columns=list(DDIC_COLUMNS))
    table["Label"] = np.arange(rows)
    table.loc[1:, list(POSITION + DISPLACEMENT)] = np.nan
    table.loc[1:, "returnStatus"] = RETURN_STATUS[Status.LEFT_FIELD.value]
    table[["Fzz", "Fyy", "Fxx"]] = 1.0
    moved = np.isfinite(np.hstack([translations, motions.rotations]).sum(axis=1))
    gradients = np.where(moved[:, None, None], matrices, np.eye(3))[:, ::-1, ::-1]
    disp = np.where(moved[:, None], translations, np.nan)[:, ::-1] / grid.voxel_size
    table.loc[motions.labels, list(POSITION)] = (centers - grid.origin)[:, ::-1] / grid.voxel_size
    table.loc[motions.labels, list(DISPLACEMENT)] = disp
    table.loc[motions.labels, list(GRADIENT)] = gradients.reshape(-1, 9)
    table.loc[motions.labels, "error"] = motions.residuals
    table.loc[motions.labels, "iterations"] = motions.iterations
    table.loc[motions.labels, "returnStatus"] = [RETURN_STATUS[str(s)] for s in motions.statuses]
    integers = ("Label", "iterations", "returnStatus", "LabelDilate")
    table = table.astype({c: np.int64 for c in integers})
    with atomic_write(path) as part:
        table.to_csv(part, sep="\t", index=False, na_rep="nan", float_format="%.10g")


def read_ddic_tsv(path: str | Path, grid: Volume) -> Motions:
    """Read the TSV of ``spam-ddic`` or `write_ddic_tsv`, in voxels of ``grid``, for instance as ``initial`` of a state.

    One row a label that has a position; label 0 is dropped.  Centres are the file's positions;
    `grainmotion.rotations.recenter` states the motions about other centres.  Where F strains, its rotation by polar
    decomposition is taken; one that strains by more than `MAX_STRAIN` is not converged.  A mirrored or singular F has
    no rotation: its row is ``not-fitted``, and its motion NaN.  ``returnStatus`` 2 becomes ``converged``,
    1 ``not-converged``, 0 or less ``not-fitted``.
    Covariances are NaN; ``residuals`` are spam's ``error`` in its own units.
    """
    table = _read_table(checked_file(path))
    table = table[(table["Label"] > 0) & table[list(POSITION)].notna().all(axis=1)]
    n, h = len(table), grid.voxel_size
    disp = table[list(DISPLACEMENT)].to_numpy(float)
    gradients = table[list(GRADIENT)].to_numpy(float).reshape(n, 3, 3)[:, ::-1, ::-1]
    given = np.isfinite(disp).all(axis=1) & np.isfinite(gradients).all(axis=(1, 2))
    faults = [_gradient_fault(f) if g else ("", False) for f, g in zip(gradients, given, strict=True)]
    moved = given & ~np.array([refused for _, refused in faults], dtype=bool)
    rotations = np.full((n, 3), np.nan)
    rotations[moved] = rotation_vector(_nearest_rotations(gradients[moved]))
    returned = table["returnStatus"].to_numpy(float)
    sound = np.array([not fault for fault, _ in faults], dtype=bool)
    converged, stopped = (returned == 2) & moved & sound, moved & ((returned == 1) | (returned == 2) & ~sound)
    statuses = np.full(n, Status.NOT_FITTED.value, dtype="<U20")
    statuses[converged], statuses[stopped] = Status.CONVERGED.value, Status.NOT_CONVERGED.value
    reasons = [
        fault or ("" if c else f"spam returned status {int(r)}")
        for c, r, (fault, _) in zip(converged, returned, faults, strict=True)
    ]
    return Motions(
        labels=table["Label"].to_numpy(np.int64),
        centers=table[list(POSITION)].to_numpy(float)[:, ::-1] * h + grid.origin,
        translations=np.where(moved[:, None], disp[:, ::-1] * h, np.nan),
        rotations=rotations,
        covariances=np.full((n, 6, 6), np.nan),
        statuses=statuses,
        residuals=table["error"].to_numpy(float),
        iterations=table["iterations"].to_numpy(np.int64),
        reasons=tuple(reasons),
    )


def _gradient_fault(gradient: NDArray[np.float64]) -> tuple[str, bool]:
    """What is wrong with F as a rotation, and whether it has none."""
    stretches = np.linalg.svd(gradient, compute_uv=False)
    if stretches[2] <= MIN_STRETCH:
        rank = int(np.count_nonzero(stretches > MIN_STRETCH))
        return f"its gradient F is singular (rank {rank}): no rotation", True
    determinant = float(np.linalg.det(gradient))
    if determinant < 0:
        return f"its gradient F is mirrored (det {determinant:.2f}): no rotation", True
    strain = float(np.abs(stretches - 1).max())
    return (f"its gradient F strains by {strain:.0%}: no rigid motion" if strain > MAX_STRAIN else "", False)


def _read_table(path: Path) -> pd.DataFrame:
    remedy = "give the …-ddic.tsv that spam-ddic writes"
    try:
        table = pd.read_csv(path, sep="\t", na_values=["nan", "inf", "-inf"])
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"it is no table ({' '.join(str(error).split())})", remedy) from error
    if "NodeNumber" in table.columns:
        raise InputError(str(path), "it holds a grid of points (NodeNumber), not grains", remedy)
    for old, new in (("error", np.nan), ("iterations", 0)):  # some of spam's scripts leave these out
        if old not in table.columns:
            table[old] = new
    needed = ("Label", *POSITION, *DISPLACEMENT, *GRADIENT, "returnStatus")
    missing = [c for c in needed if c not in table.columns]
    if missing:
        raise InputError(str(path), f"columns {missing} are missing", remedy)
    columns = [*needed, "error", "iterations"]
    numbers = table[columns].apply(pd.to_numeric, errors="coerce")
    wrong = numbers.isna() & table[columns].notna()
    if wrong.to_numpy().any():
        row, column = np.argwhere(wrong.to_numpy())[0]
        fact = f"{columns[column]} is '{table[columns].iloc[row, column]}' in row {row + 1}"
        raise InputError(str(path), fact, "give a number")
    if numbers["Label"].isna().any() or numbers["Label"].duplicated().any():
        raise InputError(str(path), "a label is missing or given twice", "give one row a grain")
    return numbers.fillna({"iterations": 0, "returnStatus": 0})


def _label_centers(image: NDArray[np.integer], labels: NDArray[np.int64], grid: Volume) -> NDArray[np.float64]:
    """Centres of mass of labels, all voxels with equal weight, mm, x y z."""
    if image.shape != grid.shape:
        raise InputError("labels", f"shape {image.shape} is not the volume's {grid.shape}", "give them on its grid")
    missing = sorted(set(labels.tolist()) - set(np.unique(image).tolist()))
    if missing:
        raise InputError("labels", f"the grains {missing[:10]} are not in it", "give the labels of this reference")
    if len(labels) == 0:
        return np.zeros((0, 3))
    places = np.array(ndimage.center_of_mass(image > 0, image, labels))
    return places[:, ::-1] * grid.voxel_size + grid.origin


def _nearest_rotations(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """R of the polar decompositions F = R U."""
    left, _, right = np.linalg.svd(matrices)
    sign = np.sign(np.linalg.det(left @ right))
    left[..., -1] *= sign[..., None]
    return left @ right
