"""Exchange with spam (https://www.spam-project.dev): the ``…-ddic.tsv`` of its discrete correlation.

One row a label, from 0 (background) to the largest; columns and their traps are in `grainmotion.io.spam_table`.
Positions and displacements are in voxels of the labelled image (voxel [0, 0, 0] is centred at 0), in z y x
order; Φ = [F | disp] carries the reference to the current state about a point p of the label.  Hence,
with h the voxel size and o the position of voxel [0, 0, 0] in the sample frame,

    pos = (centroid − o)/h,    disp = u(p)/h,    F = Ω U,    each with its x y z components written in z y x order.

The point p is the position, which is the label's centroid, or the middle of the label's bounding box (`About`):

    u(box) = u(centroid) + (F − 1)(box − centroid).

``spam-moveLabels -com`` and the strains of ``spam.deformation`` take the centroid; ``spam-ddic`` writes, and as a
start takes, the displacement of the box.  (``spam-moveLabels`` without ``-com`` takes neither, but the centroid
rounded down to whole voxels.)

Reversing the order of the axes mirrors the frame, so the rotation vector that spam derives from F,
in z y x order, is **minus** the reversed rotation vector of grainmotion; F itself needs no sign.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io import spam_table
from grainmotion.io.files import atomic_write
from grainmotion.io.spam_gradients import gradient_fault, nearest_rotations
from grainmotion.io.spam_table import (
    ABOUT_BOX,
    ADDED_COLUMNS,
    DDIC_COLUMNS,
    DISPLACEMENT,
    DISPLACEMENT_SD,
    GRADIENT,
    POSITION,
    ROTATION_SD,
    VOXEL_SIZE,
    About,
)
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume
from grainmotion.rotations import recenter, rotation_vector, skew_matrix
from grainmotion.segmentation.label_points import LabelPoints

if TYPE_CHECKING:
    import pandas as pd

TRANSLATION_TO_USE, NOT_TO_USE, WITHOUT_MOTION_STATUS = 1, -1, -7
"""``returnStatus`` of grains that did not converge: those whose translation is a result to use
(`Motions.ok_translation`), others, and those without a motion.  Converged ones have 2, and grains with a motion that
was not fitted 0."""
MAX_WRITTEN_LABEL = 1_000_000
"""Largest label that is written: a file of 300 MB."""


@checked_arguments
def write_ddic_tsv(
    path: str | Path,
    motions: Motions,
    grid: Volume,
    labels: NDArray[np.integer] | None = None,
    *,
    about: About = "centroid",
) -> None:
    """Write motions as the TSV of spam's discrete correlation.

    After spam's columns come the standard deviations of the displacement (voxels) and of rotations about z, y and x
    (degrees), ``AboutBox`` (1 for ``about="box"``) and ``VoxelSize_mm``, which spam ignores.  ``returnStatus`` is 2
    for converged grains, 1 for others whose translation is a result to use, -1 for a motion not to be used, and -7
    for labels without a motion, whose displacement is NaN.  ``error`` is the residual in line-integral units, which
    is not spam's measure; ``PSCC`` and ``pixelSearchCC``, ``deltaPhiNorm`` and ``LabelDilate`` are 0.

    Parameters
    ----------
    path : path
        The file to write.
    motions : Motions
        The motions of one state, mm and radians.
    grid : Volume
        The reference volume, in whose voxels the file is; its values do not matter.
    labels : (nz, ny, nx) int array, optional
        The labelled image that spam gets.  Positions are the centroids of its labels then, as spam-ddic requires of a
        start; else the centres of ``motions``.
    about : {"centroid", "box"}
        The point whose displacement is written: the position in the row, for ``spam-moveLabels -com`` and strains; or
        the middle of the label's bounding box, for a start of ``spam-ddic``.

    Raises
    ------
    InputError
        If a label is not positive or above a million, or the labels are of another shape, or lack a grain, or are
        missing where their boxes are asked for.

    Examples
    --------
    >>> gm.write_ddic_tsv("ddic.tsv", motions, volume, labels)
    """
    import pandas as pd  # takes half a second and 60 MB

    spam_table.check_about(about)
    if len(motions) and motions.labels.min() < 1:
        raise InputError("motions.label", f"label {motions.labels.min()}", "spam counts grains from 1; relabel them")
    if about == "box" and labels is None:
        raise InputError("about", "the middle of a bounding box needs the labels", "give labels")
    points = None if labels is None else _points_of(labels, motions, grid)
    positions, chosen = motions.centers, motions.centers
    if points is not None:
        at = points.rows_of(motions.labels)
        positions, chosen = points.centroids[at], (points.box_centers if about == "box" else points.centroids)[at]
    gradients = motions.gradients
    moved = np.asarray(np.isfinite(np.hstack([motions.translations, motions.rotations])).all(axis=1))
    disp = recenter(gradients, motions.translations, motions.centers, chosen)
    sd = _standard_deviations(motions.covariances, gradients, chosen - motions.centers)
    unit, origin = grid.voxel_size, grid.origin

    last = max([0, *motions.labels.tolist(), *([] if points is None else points.labels.tolist())])
    if last > MAX_WRITTEN_LABEL:
        fact = f"the largest is {last}, and spam wants a row for each number up to it"
        raise InputError("labels", fact, "renumber them, as skimage.segmentation.relabel_sequential does")
    table = _empty_table(last)
    table[ABOUT_BOX][:], table[VOXEL_SIZE][:] = float(about == "box"), unit
    if points is not None:
        _put(table, POSITION, points.labels, (points.centroids - origin)[:, ::-1] / unit)
    rows = motions.labels
    _put(table, POSITION, rows, (positions - origin)[:, ::-1] / unit)
    _put(table, DISPLACEMENT, rows, _where(moved, disp[:, ::-1] / unit))
    _put(table, DISPLACEMENT_SD, rows, _where(moved, sd[:, 2::-1] / unit))
    _put(table, ROTATION_SD, rows, _where(moved, np.rad2deg(sd[:, :2:-1])))
    _put(table, GRADIENT, rows, _where(moved, gradients[:, ::-1, ::-1].reshape(-1, 9), np.eye(3).ravel()))
    table["error"][rows], table["iterations"][rows] = motions.residuals, motions.iterations
    table["returnStatus"][rows] = _return_statuses(motions, moved)
    with atomic_write(path) as part:
        pd.DataFrame(table).to_csv(part, sep="\t", index=False, na_rep="nan", float_format="%.7f")


@checked_arguments
def read_ddic_tsv(
    path: str | Path, grid: Volume, labels: NDArray[np.integer] | None = None, *, about: About | None = None
) -> Motions:
    """Read the TSV of ``spam-ddic``, of spam's other discrete programs or of `write_ddic_tsv`.

    Where F strains, its rotation by polar decomposition is taken; one that strains by more than 20 % is not converged.
    A mirrored or singular F has no rotation: its row is ``not-fitted``, and its motion NaN.  ``returnStatus`` 2 becomes
    ``converged``, 1 ``not-converged``, 0 or less ``not-fitted``, and below 0 the motion is NaN.

    Parameters
    ----------
    path : path
        The file.
    grid : Volume
        The volume in whose voxels the file is; its values do not matter.
    labels : (nz, ny, nx) int array, optional
        The labelled image that spam had, for the bounding boxes.  Without it, and for labels that it lacks, the
        position is **taken for the middle of the box**, which puts the translation off by (F − 1) times the
        vector from one to the other: half a voxel for 10 degrees and 3 voxels.
    about : {"centroid", "box"}, optional
        The point whose displacement the file gives: the position in the row, or the middle of the label's bounding
        box.  By default as the file's column ``AboutBox`` says, else "box" for a file with the columns of spam-ddic,
        and "centroid" for those of other programs.

    Returns
    -------
    Motions
        mm and radians, one row a label that has a position, without label 0, about the file's positions.  Covariances
        are the variances of the file's columns of standard deviations, NaN without them; residuals are spam's
        ``error``, in its own units.

    Raises
    ------
    InputError
        If the file is no such table, truncated or written with decimal commas, a label is not whole or is there twice,
        columns were exchanged as by ``spam-ddic -skp``, or the file says that its voxels have another size.

    Examples
    --------
    >>> gm.write_ddic_tsv("ddic.tsv", motions, volume)
    >>> again = gm.read_ddic_tsv("ddic.tsv", volume)
    >>> np.allclose(again.translations, motions.translations, atol=1e-4)
    True
    """
    spam_table.check_about(about)
    table = spam_table.read_table(path)
    spam_table.check_voxel_size(path, table, grid.voxel_size)
    box = spam_table.point_of(table, about) == "box"
    correlated = bool(table.attrs["written by spam-ddic"])
    table = table[(table["Label"] > 0) & table[list(POSITION)].notna().all(axis=1)]
    n, h = len(table), grid.voxel_size
    numbers = table["Label"].to_numpy(np.int64)
    centers = table[list(POSITION)].to_numpy(float)[:, ::-1] * h + grid.origin
    translations = table[list(DISPLACEMENT)].to_numpy(float)[:, ::-1] * h
    gradients = table[list(GRADIENT)].to_numpy(float).reshape(n, 3, 3)[:, ::-1, ::-1]
    if box and labels is not None:
        points = LabelPoints.of(labels, grid)
        at = points.rows_of(numbers)
        boxes = np.where(at[:, None] >= 0, points.box_centers[at], centers) if len(points.labels) else centers
        translations = recenter(gradients, translations, boxes, centers)
    returned = table["returnStatus"].to_numpy(np.int64)
    given = np.isfinite(translations).all(axis=1) & np.isfinite(gradients).all(axis=(1, 2)) & (returned >= 0)
    faults = [gradient_fault(f) if g else ("", False) for f, g in zip(gradients, given, strict=True)]
    moved = given & ~np.array([refused for _, refused in faults], dtype=bool)
    rotations = np.full((n, 3), np.nan)
    rotations[moved] = rotation_vector(nearest_rotations(gradients[moved]))
    sound = np.array([not fault for fault, _ in faults], dtype=bool)
    converged, stopped = (returned == 2) & moved & sound, moved & ((returned == 1) | (returned == 2) & ~sound)
    statuses = np.full(n, Status.NOT_FITTED.value, dtype="<U20")
    statuses[converged], statuses[stopped] = Status.CONVERGED.value, Status.NOT_CONVERGED.value
    return Motions(
        labels=numbers,
        centers=centers,
        translations=_where(moved, translations),
        rotations=rotations,
        covariances=_covariances(table, h),
        statuses=statuses,
        residuals=table["error"].to_numpy(float),
        iterations=table["iterations"].to_numpy(np.int64),
        reasons=tuple(
            fault or ("" if c else spam_table.meaning(int(r), correlated=correlated))
            for c, r, (fault, _) in zip(converged, returned, faults, strict=True)
        ),
    )


def _points_of(labels: NDArray[np.integer], motions: Motions, grid: Volume) -> LabelPoints:
    """The points of labels, which hold all grains of the motions."""
    points = LabelPoints.of(labels, grid)
    missing = sorted(set(motions.labels.tolist()) - set(points.labels.tolist()))
    if missing:
        raise InputError("labels", f"the grains {missing[:10]} are not in it", "give the labels of this reference")
    return points


def _empty_table(last: int) -> dict[str, Float]:
    """Columns of rows 0 to ``last``: the identity for the background, and no motion for labels."""
    table: dict[str, Float] = {column: np.zeros(last + 1) for column in (*DDIC_COLUMNS, *ADDED_COLUMNS)}
    table["Label"][:] = np.arange(last + 1)
    for column in (*POSITION, *DISPLACEMENT, *DISPLACEMENT_SD, *ROTATION_SD):
        table[column][1:] = np.nan
    table["returnStatus"][1:] = WITHOUT_MOTION_STATUS
    for column in ("Fzz", "Fyy", "Fxx"):
        table[column][:] = 1
    return table


def _put(table: dict[str, Float], columns: tuple[str, ...], rows: NDArray[np.int64], values: Float) -> None:
    """One value a row and column."""
    for k, column in enumerate(columns):
        table[column][rows] = values[:, k]


def _where(rows: NDArray[np.bool_], values: Float, other: Float | float = np.nan) -> Float:
    """Values in some rows, others elsewhere."""
    return np.where(rows[:, None], values, other)


def _return_statuses(motions: Motions, moved: NDArray[np.bool_]) -> NDArray[np.int64]:
    """spam's status of each grain."""
    returned = np.where(motions.ok_translation, TRANSLATION_TO_USE, NOT_TO_USE)
    returned[motions.ok] = 2
    returned[motions.statuses == Status.NOT_FITTED.value] = 0
    returned[~moved] = WITHOUT_MOTION_STATUS
    return returned


def _standard_deviations(covariances: Float, gradients: Float, arms: Float) -> Float:
    """Of u and δ ``(n, 6)`` about points that lie ``arms`` (mm) from the centres: u′ = u + (F − 1) arm, δ′ = δ."""
    change = np.tile(np.eye(6), (len(arms), 1, 1))
    change[:, :3, 3:] = -skew_matrix(np.einsum("nij,nj->ni", gradients, arms))
    moved = change @ covariances @ change.swapaxes(1, 2)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.diagonal(moved, axis1=1, axis2=2))


def _covariances(table: pd.DataFrame, voxel_size: float) -> Float:
    """Variances from the columns of standard deviations; NaN without them."""
    if not set(DISPLACEMENT_SD + ROTATION_SD) <= set(table.columns):
        return np.full((len(table), 6, 6), np.nan)
    lengths = table[list(DISPLACEMENT_SD)].to_numpy(float)[:, ::-1] * voxel_size
    angles = np.deg2rad(table[list(ROTATION_SD)].to_numpy(float)[:, ::-1])
    return np.hstack([lengths, angles])[:, :, None] ** 2 * np.eye(6)
