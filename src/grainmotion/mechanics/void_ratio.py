"""Local void ratio: the space around each grain over the grain itself, by Voronoi cells.

Two cells are offered.  *Radical* (Laguerre, power diagram): flat faces, from centres and the radii of balls of the
same volume; exact for spheres of any sizes and quick, wrong for elongated grains, whose ends may reach beyond their
cell.  *Set* (Schaller et al., Philosophical Magazine 93, 3993, 2013): each voxel of the void belongs to the grain whose
surface is nearest, whatever the shapes; precise to the voxels.

A cell that reaches the border of the field, or a free surface of the packing, holds what is outside as well: grains
whose cell is at the border, or that are on the hull of the tetrahedra between centres, have no void ratio to use.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.analysis.deformed_volume import rebuild, typical_attenuation
from grainmotion.errors import InputError
from grainmotion.mechanics.columns import VOID_COLUMNS, VOIDS_CONTENT
from grainmotion.mechanics.radical_cells import cell_variances, radical_cells
from grainmotion.mechanics.surfaces import is_slice, surface_of
from grainmotion.mechanics.tetrahedra import tessellate
from grainmotion.model.described_table import described
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.progress import counted
from grainmotion.model.scene import Scene
from grainmotion.model.summary import Summarised, Summary
from grainmotion.model.volume import Volume
from grainmotion.rotations import recenter

if TYPE_CHECKING:
    import pandas as pd

Cells = Literal["set", "radical"]


REACH_IN_RADII = 1.5
"""Distance up to which void belongs to a grain, in radii of the largest: pores between touching grains are narrower."""


NEAR_A_FACE = 2.5
"""Difference of the distances to two grains, voxels, below which the face between their cells may cross a voxel."""


@dataclass(frozen=True, eq=False, repr=False)
class VoidRatios(Summarised):
    """Cell and void ratio of each of n grains, in one state.

    Attributes
    ----------
    labels : (n,) int array
        Grains that have a place in the state.
    grain_volumes, cell_volumes : (n,) arrays
        mm³.  That of a grain is of its voxels above half of its typical attenuation, the same in every state.
    cell_volume_sds : (n,) array
        Standard deviations of the cells' volumes by the translations of the grains around them, mm³; 0 in the
        reference.  Those of grain volumes, the same in every state, are not in them.
    inside : (n,) bool array
        Cells that neither the border of the field nor a free surface cuts: only their void ratio is a result to use.
    cells : {"set", "radical"}
        How the space was shared.

    Examples
    --------
    >>> voids = gm.void_ratio(grains, volume)
    >>> voids.labels.tolist(), voids.void_ratios.shape
    ([1, 2, 3, 4], (4,))
    """

    labels: NDArray[np.int64]
    grain_volumes: Float
    cell_volumes: Float
    cell_volume_sds: Float
    inside: NDArray[np.bool_]
    cells: Cells

    @property
    def void_ratios(self) -> Float:
        """e = (cell − grain)/grain, ``(n,)``; NaN for cells that are not inside."""
        ratios = self.cell_volumes / self.grain_volumes - 1
        return np.where(self.inside, ratios, np.nan)

    @property
    def void_ratio_sds(self) -> Float:
        """Standard deviations of the void ratios by the translations, ``(n,)``; NaN for cells that are not inside."""
        return np.where(self.inside, self.cell_volume_sds / self.grain_volumes, np.nan)

    @property
    def mean(self) -> float:
        """Void ratio of all cells inside together; NaN if there are none."""
        grains = self.grain_volumes[self.inside].sum()
        return float(self.cell_volumes[self.inside].sum() / grains - 1) if grains > 0 else float("nan")

    def to_dataframe(self) -> pd.DataFrame:
        """One row a grain: label, volumes (mm³), whether the cell is inside, void ratio.

        Returns
        -------
        DataFrame
            Its ``attrs`` tell units and meanings of the columns, version and the kind of cells.
        """
        import pandas as pd  # takes half a second

        table = pd.DataFrame({
            "label": self.labels, "grain_volume": self.grain_volumes, "cell_volume": self.cell_volumes,
            "inside": self.inside, "void_ratio": self.void_ratios, "sd_void_ratio": self.void_ratio_sds,
        })  # fmt: skip
        return described(table, VOID_COLUMNS, VOIDS_CONTENT, cells=self.cells)

    def _summary(self) -> Summary:
        rows = (
            ("mean void ratio", f"{self.mean:.4g}"),
            ("cells", f"{self.cells}, {int(self.inside.sum())} of {len(self.labels)} inside"),
        )
        return Summary("VoidRatios", f"mean {self.mean:.4g}, {rows[1][1]}", rows)


@checked_arguments
def void_ratio(grains: GrainSet, grid: Volume, motions: Motions | None = None, *, cells: Cells = "set") -> VoidRatios:
    """Void ratio around each grain, in a state, or in the reference without motions.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference.
    grid : Volume
        The field; its values do not matter.  A cell at its border is cut.
    motions : Motions, optional
        Of the state, mm and radians.  Grains whose translation is no result to use have no cell, and their neighbours'
        cells take their space: where many are missing, void ratios are too large.
    cells : {"set", "radical"}
        By the nearest surface in voxels of ``grid``, or by planes between balls of the same volumes.  In a slice one
        voxel thick only ``"set"`` is right: by distances between voxels, in its plane.

    Returns
    -------
    VoidRatios
        Of the grains that have a place in the state.

    Raises
    ------
    InputError
        If ``cells`` is unknown, or ``motions`` names a label that is not among the grains.

    Examples
    --------
    >>> voids = gm.void_ratio(grains, volume, motions)
    >>> len(voids.to_dataframe())
    4
    """
    if cells not in ("set", "radical"):
        raise InputError("void_ratio.cells", f"'{cells}' is unknown", 'use "set" or "radical"')
    motions = _usable(grains, motions)
    row_of = {int(label): row for row, label in enumerate(grains.labels)}
    unknown = sorted({int(label) for label in motions.labels} - set(row_of))
    if unknown:
        fact = f"labels {unknown[:10]} are not among the grains"
        raise InputError("motions.label", fact, "use motions of this reference")
    rows = [row_of[int(label)] for label in motions.labels]
    volumes = np.array([_grain_volume(grains.grains[row]) for row in counted(rows)])
    shifts = recenter(motions.gradients, motions.translations, motions.centers, grains.centers[rows])
    places, radii = grains.centers[rows] + shifts, np.cbrt(0.75 / np.pi * volumes)
    if cells == "set":
        spaces, inside = _set_cells(grains, motions, grid, volumes)
    else:
        spaces, inside = radical_cells(places, radii, grid)
    variances = cell_variances(places, radii, grid, motions.covariances[:, :3, :3])
    current = motions.centers + motions.translations
    inside &= ~tessellate(current).at_hull & (spaces > 0) & (volumes > 0)
    return VoidRatios(motions.labels, volumes, spaces, np.sqrt(variances), inside, cells)


def _usable(grains: GrainSet, motions: Motions | None) -> Motions:
    """Motions of the grains that have a place, all taken as converged; no motion for the reference."""
    if motions is None:
        motions = Motions.identity(grains.labels, grains.centers)
        motions = replace(motions, covariances=np.zeros((len(motions), 6, 6)))
        kept = np.arange(len(motions))
    else:
        finite = np.isfinite(np.hstack([motions.translations, motions.rotations])).all(axis=1)
        kept = np.flatnonzero(motions.ok_translation & finite)
    return replace(
        Motions.identity(motions.labels[kept], motions.centers[kept]),
        translations=motions.translations[kept],
        rotations=motions.rotations[kept],
        covariances=motions.covariances[kept],
        statuses=np.full(len(kept), Status.CONVERGED.value, dtype="<U20"),
        strains=None if motions.strains is None else motions.strains[kept],
        strain_covariances=None if motions.strain_covariances is None else motions.strain_covariances[kept],
        fit=motions.fit,
    )


def _grain_volume(grain: Grain) -> float:
    """Volume of the voxels above half of a grain's typical attenuation, mm³."""
    volume = grain.volume if grain.fine is None else grain.fine
    level = typical_attenuation(grain) / 2
    return float(np.count_nonzero(volume.array > level)) * volume.voxel_size**3 if level > 0 else 0.0


def _set_cells(grains: GrainSet, motions: Motions, grid: Volume, volumes: Float) -> tuple[Float, NDArray[np.bool_]]:
    """Volumes of the cells by the nearest surface, mm³, and whether each is closed: by other cells, not by the border.

    First by distances between voxels; then those near the face between two cells are shared by their distances to the
    surfaces of both grains.  The first alone is wrong by up to half a voxel on every face.
    """
    n = len(motions)
    _, labels = rebuild(grains, motions, grid)
    reach = REACH_IN_RADII * np.cbrt(0.75 / np.pi * volumes.max(initial=0.0)) / grid.voxel_size
    nearest, second = (np.full(grid.shape, np.inf, np.float32) for _ in range(2))
    owner, other = (np.full(grid.shape, -1, np.int32) for _ in range(2))
    boxes = ndimage.find_objects(labels, int(motions.labels.max(initial=0)))
    for row, label in enumerate(counted(motions.labels)):
        box = boxes[int(label) - 1]
        if box is None:
            continue
        pad = int(np.ceil(reach)) + 1
        wide = tuple(slice(max(s.start - pad, 0), min(s.stop + pad, k)) for s, k in zip(box, grid.shape, strict=True))
        distance = edt.edt(labels[wide] != label)
        distance[distance > reach] = np.inf
        first = distance < nearest[wide]
        follows = ~first & (distance < second[wide])
        second[wide] = np.where(first, nearest[wide], np.where(follows, distance, second[wide]))
        other[wide] = np.where(first, owner[wide], np.where(follows, row, other[wide]))
        nearest[wide][first], owner[wide][first] = distance[first], row
    if grains.scene.bodies:  # they are no void
        owner[_solid_bodies(grains, motions, grid) & (labels == 0)] = -1
    counts = np.bincount(owner[owner >= 0], minlength=n).astype(float)
    with np.errstate(invalid="ignore"):
        between = np.argwhere((owner >= 0) & (other >= 0) & (second - nearest < NEAR_A_FACE))
    rows = np.stack([owner[tuple(between.T)], other[tuple(between.T)]])
    lost = 1 - _shares(grains, motions, grid, between, rows)
    counts += np.bincount(rows[1], lost, n) - np.bincount(rows[0], lost, n)
    return counts * grid.voxel_size**3, ~_open_cells(owner, nearest, reach, n)


def _shares(
    grains: GrainSet, motions: Motions, grid: Volume, voxels: NDArray[np.int64], rows: NDArray[np.int32]
) -> Float:
    """Share of each voxel ``(k, 3)``, z y x, that belongs to the first of two grains, ``rows (2, k)`` of the motions.

    The difference of the distances to both surfaces grows by two voxels while the face between the cells crosses one.
    """
    places = grid.origin + grid.voxel_size * voxels[:, ::-1]
    if is_slice(grains):  # distances between voxels decide
        return np.ones(len(voxels))
    distances = np.zeros(rows.shape)
    row_of = {int(label): row for row, label in enumerate(grains.labels)}
    order = np.argsort(rows.ravel(), kind="stable")
    ends = np.searchsorted(rows.ravel()[order], np.arange(len(motions) + 1))
    inverses = np.linalg.inv(motions.gradients)
    for k, label in enumerate(counted(motions.labels)):
        at = order[ends[k] : ends[k + 1]]
        surface = surface_of(grains.grains[row_of[int(label)]], grains.voxel_size) if len(at) else None
        if surface is not None:
            moved = places[at % len(voxels)] - motions.translations[k] - motions.centers[k]
            distances.ravel()[at] = surface.distances(moved @ inverses[k].T + motions.centers[k], np.inf)[0]
    return np.asarray(np.clip(0.5 + (distances[1] - distances[0]) / (2 * grid.voxel_size), 0, 1))


def _open_cells(owner: NDArray[np.int32], nearest: NDArray[np.float32], reach: float, count: int) -> NDArray[np.bool_]:
    """Cells ``(count,)`` at the border of the grid, or as wide as distances were looked for: air is beyond them."""
    found = np.zeros(count + 1, dtype=bool)  # the last is of voxels without an owner
    for axis in range(3):
        if owner.shape[axis] > 1:
            for end in (0, -1):
                found[np.unique(owner.take(end, axis=axis))] = True
    found[np.unique(owner[nearest > reach - 1])] = True
    return found[:count]


def _solid_bodies(grains: GrainSet, motions: Motions, grid: Volume) -> NDArray[np.bool_]:
    """Voxels that pistons, walls and other bodies hold in the state, where they are then."""
    solid = np.zeros(grid.shape, dtype=bool)
    nothing = replace(Motions.identity(np.zeros(0, dtype=np.int64), np.zeros((0, 3))), fit=motions.fit)
    for body in grains.scene.bodies:
        if body.kind == "rest" or not (body.volume.array > 0).any():
            continue
        alone = replace(grains, scene=Scene((body,)))
        moved, _ = rebuild(alone, nothing, grid)
        solid |= moved.array > 0.5 * np.median(body.volume.array[body.volume.array > 0])
    return solid
