"""Contacts between grains, in the reference or in a later state, from their surfaces moved by their motions.

Two labels that share a face of a voxel need not touch: blur and voxels close gaps of about a voxel, so that adjacency
of labels finds far too many contacts (Wiebicke, Andò, Herle and Viggiani, Measurement Science and Technology 28,
124007, 2017).  Here the gap between two grains is measured: the least signed distance of points on the surface of
either to the surface of the other, in the frame of that grain, pair by pair.  A pair is in contact if its gap is below
a tolerance by more than `CLEAR_GAP_SDS` of its standard deviations, open if it is above by as much, else indeterminate.

The reference scan sets the limit: labels are cut where grains touch, so gaps there are never negative, and blur closes
gaps of up to half a voxel (decision 0044).  Grains that touch at several places have one contact: the closest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.columns import CONTACT_COLUMNS, CONTACTS_CONTENT
from grainmotion.mechanics.placed_grains import PlacedGrains, placed_grains
from grainmotion.mechanics.surfaces import Surface, SurfaceCache
from grainmotion.model.described_table import described
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.progress import counted
from grainmotion.model.summary import Summarised, Summary

if TYPE_CHECKING:
    import pandas as pd

TOUCHING, OPEN, INDETERMINATE, OVERLAP = "contact", "open", "indeterminate", "overlap"
DEFAULT_GAP_TOLERANCE = 0.7
"""Gap below which two grains are in contact, voxels."""
SURFACE_SD = 0.1
"""Standard deviation of a gap by what voxels hide of two surfaces, voxels (decision 0044)."""
CLEAR_GAP_SDS = 2.0
"""Standard deviations by which a gap must be off the tolerance."""
LISTED_GAP = 2.0
"""Pairs are listed up to this gap, voxels."""
PATCH_DEPTH = 1.0
"""Points whose gap is at most this much above the least, voxels, make the place and the normal of a contact."""
MAX_OVERLAP = 1.0
"""Overlap of two grains that the voxels explain, voxels; beyond it, one of their motions is wrong."""


@dataclass(frozen=True, eq=False, repr=False)
class Contacts(Summarised):
    """Pairs of grains that touch or nearly touch, in one state.

    Attributes
    ----------
    pairs : (m, 2) int array
        Labels of the two grains, the smaller one first.
    gaps, gap_sds : (m,) arrays
        Distance of their surfaces, mm, negative if they overlap, and its standard deviation.
    kinds : (m,) array of str
        ``contact``, ``open``, ``indeterminate`` (the gap may be on either side of the tolerance) or ``overlap``
        (more than rigid grains can: one of the motions is wrong).
    points, normals : (m, 3) arrays
        Place of the contact, mm, and unit normal from the first grain to the second, in this state.
    branches : (m, 3) array
        Vector from the centre of mass of the first grain to that of the second, mm, in this state.
    labels : (n,) int array
        Grains that were looked at.
    at_border : (n,) bool array
        Of these, the ones that touch the border of the field of view: some of their contacts are not seen.
    left_out : tuple of (int, str)
        Grains that were not, and why.
    tolerance : float
        Gap of the decision, mm.
    voxel_size : float
        Of the reference, mm.

    Examples
    --------
    >>> pairs = gm.contacts(grains)
    >>> pairs.to_dataframe().columns[:3].tolist()
    ['label_1', 'label_2', 'kind']
    """

    pairs: NDArray[np.int64]
    gaps: Float
    gap_sds: Float
    kinds: NDArray[np.str_]
    points: Float
    normals: Float
    branches: Float
    labels: NDArray[np.int64]
    at_border: NDArray[np.bool_]
    left_out: tuple[tuple[int, str], ...]
    tolerance: float
    voxel_size: float

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Pairs in contact, ``(m,)``."""
        return self.kinds == TOUCHING

    def to_dataframe(self) -> pd.DataFrame:
        """One row a pair: labels, kind, gap, place, normal and branch vector, mm.

        Returns
        -------
        DataFrame
            Its ``attrs`` tell units and meanings of the columns, frame, version and tolerance (mm).
        """
        import pandas as pd  # takes half a second

        columns: dict[str, object] = {"label_1": self.pairs[:, 0], "label_2": self.pairs[:, 1], "kind": self.kinds}
        columns |= {"gap": self.gaps, "sd_gap": self.gap_sds}
        for name, vectors in (("", self.points), ("n", self.normals), ("branch_", self.branches)):
            columns |= {f"{name}{axis}": c for axis, c in zip("xyz", vectors.T, strict=True)}
        return described(pd.DataFrame(columns), CONTACT_COLUMNS, CONTACTS_CONTENT, tolerance=self.tolerance)

    def _summary(self) -> Summary:
        kinds, counts = np.unique(self.kinds, return_counts=True)
        rows = [(str(kind), str(count)) for kind, count in zip(kinds, counts, strict=True)]
        line = ", ".join(f"{count} {kind}" for kind, count in rows)
        rows += [("tolerance", f"{self.tolerance:.4g} mm"), ("grains", str(len(self.labels)))]
        rows += [("left out", str(len(self.left_out)))] if self.left_out else []
        return Summary(f"Contacts: {len(self)} pairs of {len(self.labels)} grains", line, tuple(rows))


@checked_arguments
def contacts(grains: GrainSet, motions: Motions | None = None, *, tolerance: float = DEFAULT_GAP_TOLERANCE) -> Contacts:
    """Contacts between grains in a state, or in the reference without motions.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference, with their own voxels.
    motions : Motions, optional
        Of the state, mm and radians.  Grains whose translation is no result to use are left out, and told; so are all
        grains of a slice one voxel thick.
    tolerance : float
        Gap below which two grains are in contact, in voxels of the reference.

    Returns
    -------
    Contacts
        Every pair with a gap of up to `LISTED_GAP` voxels above the tolerance.

    Raises
    ------
    InputError
        If the tolerance is not positive, or ``motions`` names a label that is not among the grains.

    Examples
    --------
    >>> pairs = gm.contacts(grains)
    >>> pairs.labels.tolist()
    [1, 2, 3, 4]
    """
    check_tolerance("contacts.tolerance", tolerance)
    placed, left_out = placed_grains(grains, motions)
    h = grains.voxel_size
    found = list(_measured(grains, placed, h * (tolerance + LISTED_GAP)))
    m = len(found)
    columns = [np.array([row[k] for row in found]) for k in range(5)] if m else [np.zeros(0)] * 5
    pairs, points, normals = columns[0].reshape(m, 2).astype(np.int64), *(c.reshape(m, 3) for c in columns[3:])
    gaps, sds = columns[1], np.hypot(columns[2], SURFACE_SD * h)
    order = np.lexsort(pairs.T[::-1])
    labels = grains.labels[placed.rows]
    row_of = {int(label): k for k, label in enumerate(labels)}
    current = placed.centers + placed.translations
    ends = np.array([[row_of[int(a)], row_of[int(b)]] for a, b in pairs], dtype=np.int64).reshape(m, 2)
    branches = current[ends[:, 1]] - current[ends[:, 0]]
    border = np.array([grains.grains[row].touches_border for row in placed.rows], dtype=bool)
    kinds = gap_kinds(gaps, sds, tolerance * h, h)
    return Contacts(
        pairs[order], gaps[order], sds[order], kinds[order], points[order], normals[order], branches[order], labels,
        border, left_out, tolerance * h, h,
    )  # fmt: skip


def _measured(
    grains: GrainSet, placed: PlacedGrains, reach: float
) -> Iterator[tuple[tuple[int, int], float, float, Float, Float]]:
    """Labels, gap, its standard deviation by the motions, place and normal of each pair nearer than ``reach``, mm."""
    surfaces, h = SurfaceCache(grains), grains.voxel_size
    current = placed.centers + placed.translations
    halves = np.array([_outer_radius(grains, int(row)) for row in placed.rows])
    pairs = cKDTree(current).query_pairs(2 * halves.max(initial=0.0) + reach, output_type="ndarray")
    apart = np.linalg.norm(current[pairs[:, 0]] - current[pairs[:, 1]], axis=1)
    pairs = pairs[apart < halves[pairs].sum(axis=1) + reach]
    by_height = np.argsort(current[pairs[:, 0], 2], kind="stable")  # surfaces are used again soon
    for a, b in counted(pairs[by_height]):
        i, j = sorted((int(a), int(b)), key=lambda k: int(grains.labels[placed.rows[k]]))
        first, second = surfaces[int(placed.rows[i])], surfaces[int(placed.rows[j])]
        closest = None if first is None or second is None else _closest(placed, (i, first), (j, second), reach, h)
        if closest is None or closest[0] > reach:
            continue
        gap, point, normal = closest
        variance = 0.0
        for k in (i, j):
            lever = placed.lever(k, point, normal)
            variance += float(lever @ placed.covariances[k] @ lever)
        labels = int(grains.labels[placed.rows[i]]), int(grains.labels[placed.rows[j]])
        yield labels, gap, np.sqrt(max(variance, 0.0)) if np.isfinite(variance) else np.inf, point, normal


def _outer_radius(grains: GrainSet, row: int) -> float:
    """Radius of a ball about the grain's centre that holds its voxels, mm."""
    volume = grains.grains[row].volume
    middle = np.array(volume.center)
    half = volume.voxel_size * np.array(volume.shape[::-1]) / 2
    return float(np.linalg.norm(np.abs(middle - grains.grains[row].center) + half))


def _closest(
    placed: PlacedGrains, first: tuple[int, Surface], second: tuple[int, Surface], reach: float, voxel_size: float
) -> tuple[float, Float, Float] | None:
    """Gap, place and normal (first to second) where two surfaces come closest, in the state; None if none is near."""
    inside = _inside(placed, first, second)
    if inside is not None:
        return inside
    depth, limit = PATCH_DEPTH * voxel_size, reach + voxel_size
    sides = []
    for (k, own), (other_k, other), sign in ((first, second, 1.0), (second, first, -1.0)):
        moved = placed.to_state(k, own.points)
        local = placed.to_reference(other_k, moved)
        near = np.linalg.norm(local - placed.centers[other_k], axis=1) < other.radius + limit
        distances, index = other.distances(local[near], limit)
        if not np.isfinite(distances).any():
            return None
        sides.append((distances, moved[near], own.normals[near], other.normals[index], sign, k, other_k))
    gap = min(float(side[0].min()) for side in sides)
    point, normal = np.zeros(3), np.zeros(3)
    for distances, places, own_normals, other_normals, sign, k, other_k in sides:
        patch = distances <= max(gap, float(distances.min())) + depth
        outward = placed.gradients[k] @ own_normals[patch].mean(axis=0)
        inward = placed.gradients[other_k] @ other_normals[patch].mean(axis=0)
        normal += sign * (outward - inward)
        point += places[patch].mean(axis=0) / 2
    length = float(np.linalg.norm(normal))
    if length == 0:
        return None
    return gap, point, normal / length


def _inside(
    placed: PlacedGrains, first: tuple[int, Surface], second: tuple[int, Surface]
) -> tuple[float, Float, Float] | None:
    """Gap, place and direction of a grain whose centre is inside another, as only a wrong motion puts it, else None."""
    current = placed.centers + placed.translations
    depth = 0.0
    for (k, _), (other_k, other) in ((first, second), (second, first)):
        local = placed.to_reference(other_k, current[k][None])
        if np.linalg.norm(local[0] - placed.centers[other_k]) < other.radius:
            depth = min(depth, float(other.distances(local, np.inf)[0][0]))
    if depth >= 0:
        return None
    branch = current[second[0]] - current[first[0]]
    length = float(np.linalg.norm(branch))
    direction = branch / length if length > 0 else np.array([0.0, 0.0, 1.0])
    return depth, (current[first[0]] + current[second[0]]) / 2, direction


def check_tolerance(where: str, tolerance: float) -> None:
    """Raise `InputError` unless a tolerance is positive."""
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise InputError(where, f"must be > 0, got {tolerance}", "give it in voxels, such as 0.7")


def gap_kinds(gaps: Float, sds: Float, tolerance: float, voxel_size: float) -> NDArray[np.str_]:
    """The kind of each pair by its gap, the gap's standard deviation, the tolerance and the voxel size, mm."""
    clear = CLEAR_GAP_SDS * sds
    kinds = np.full(len(gaps), INDETERMINATE, dtype="<U13")
    kinds[gaps + clear < tolerance] = TOUCHING
    kinds[gaps - clear > tolerance] = OPEN
    kinds[gaps + clear < -MAX_OVERLAP * voxel_size] = OVERLAP
    return kinds
