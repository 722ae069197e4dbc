"""Phases of a volume: air, liquid, grains of one or several materials, and bodies such as pistons and walls.

Levels of attenuation are found in the insides of bodies (`uniform_cores`), every voxel gets its level (`level_map`),
and how the levels lie in each other says which is a liquid (`level_kinds`).  Grains are told from bodies by size and
shape (`large_bodies`), so a solid level may hold both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.filters import threshold_otsu

from grainmotion.model.volume import Volume
from grainmotion.segmentation.border import beyond_field
from grainmotion.segmentation.labels import checked_labels
from grainmotion.segmentation.level_kinds import Neighbours, liquid_levels, without_inclusions
from grainmotion.segmentation.level_map import flooded, without_shells
from grainmotion.segmentation.settings import PhaseKind, PhaseSettings
from grainmotion.segmentation.uniform_cores import Bools, Floats, UniformCores

SURFACE = 2
"""Voxels around a label that are its own blurred surface."""
LABELLED = 0.1
"""Share of a level's voxels with a label, from which the level is one of grains."""
MIN_BODY_SHARE = 5e-4
"""Share of all voxels of a body; less is an artefact of the scan, and counts as air."""
PHASE_KINDS: tuple[PhaseKind, ...] = ("air", "liquid", "grains", "body")
"""Kinds of phases by number."""
_NUMBER_OF = {str(kind): number for number, kind in enumerate(PHASE_KINDS)}


@dataclass(frozen=True)
class Phase:
    """What a part of a volume is.

    Attributes
    ----------
    kind : {"air", "liquid", "grains", "body"}
        A body is a piston, a wall or a wire.
    attenuation : float
        Median of its insides, 1/mm.
    share : float
        Of all voxels.
    """

    kind: PhaseKind
    attenuation: float
    share: float

    def __str__(self) -> str:
        return f"{self.kind} {self.attenuation:.3g} 1/mm ({self.share:.1%})"


@dataclass(frozen=True, eq=False)
class Levels:
    """Levels of attenuation, where they are, and which are no solid.

    Attributes
    ----------
    values : (k,) array
        Attenuation, rising, 1/mm.
    kinds : tuple of str
        "air", "liquid", "solid" (grains or bodies), or what was told.
    of_voxel : (nz, ny, nx) int8 array
        Number of each voxel's level.
    """

    values: NDArray[np.float64]
    kinds: tuple[str, ...]
    of_voxel: NDArray[np.int8]

    @property
    def solids(self) -> tuple[int, ...]:
        """Numbers of the levels that may hold grains."""
        return tuple(k for k, kind in enumerate(self.kinds) if kind in ("solid", "grains"))

    @property
    def has_liquid(self) -> bool:
        """Whether a level is a liquid."""
        return "liquid" in self.kinds

    def half_way(self, grains: NDArray[np.intp]) -> float:
        """The level half-way from what surrounds the faintest grains, given by their levels, to these, 1/mm."""
        faintest = int(grains.min()) if len(grains) else len(self.values) - 1
        around = max((k for k in range(faintest) if self.kinds[k] in ("air", "liquid")), default=0)
        return float(self.values[faintest] + self.values[around]) / 2

    def is_solid(self) -> Bools:
        """Voxels of grains and bodies."""
        solid = np.array([kind not in ("air", "liquid") for kind in self.kinds])
        return np.asarray(solid[self.of_voxel])

    def surrounding(self) -> Floats:
        """Attenuation of the air or liquid nearest to each voxel, 1/mm."""
        if not self.has_liquid:
            return np.full(self.of_voxel.shape, self.values[0], np.float32)
        nearest = ndimage.distance_transform_edt(self.is_solid(), return_distances=False, return_indices=True)
        return self.values.astype(np.float32)[self.of_voxel[tuple(nearest)]]


def find_levels(
    array: Floats, threshold: float, told: Sequence[PhaseSettings] = (), beyond: Bools | None = None
) -> Levels | None:
    """Levels of a volume.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    threshold : float
        Attenuation that separates bodies from air roughly, as Otsu's does, 1/mm.
    told : sequence of PhaseSettings
        Phases that are known; found if empty.  Air without attenuation is added unless it is told.
    beyond : (nz, ny, nx) bool array, optional
        Voxels beyond the field of view, which make no level of their own.

    Returns
    -------
    Levels or None
        None if there are no two levels above the lowest, so that one threshold separates all there is.
    """
    if told and all(phase.kind != "air" for phase in told):
        told = (PhaseSettings("air", 0.0), *told)
    cores = UniformCores.of(array, threshold, [phase.bounds for phase in told], beyond)
    if len(cores.levels) < 3 and not told:
        return None
    regions = flooded(array, cores)
    neighbours = Neighbours.of(regions, len(cores.level_of) - 1)
    if told:
        kinds, level_of = tuple(str(told[k].kind) for k in cores.told), cores.level_of
    else:
        level_of = cores.level_of
        liquid = liquid_levels(array, level_of.astype(np.int8)[regions], cores.levels)
        kinds = tuple("air" if k == 0 else "liquid" if k in liquid else "solid" for k in range(len(cores.levels)))
        level_of = without_inclusions(cores, neighbours, (0, *liquid))
    of_voxel = without_shells(array, level_of.astype(np.int8)[regions], cores.levels)
    return Levels(cores.levels, kinds, of_voxel)


@dataclass(frozen=True, eq=False)
class PhaseMap:
    """The phase of every voxel.

    Attributes
    ----------
    phases : tuple of Phase
        By rising attenuation, air first.
    index : (nz, ny, nx) int8 array
        Number of each voxel's phase in ``phases``.
    """

    phases: tuple[Phase, ...]
    index: NDArray[np.int8]

    @classmethod
    def of(cls, array: Floats, levels: Levels, labels: NDArray[np.integer]) -> PhaseMap:
        """From levels and the labels of the grains; solids without a label are bodies."""
        level, count = levels.of_voxel.copy(), len(levels.values)
        labelled = np.bincount(level[labels > 0], minlength=count)
        with_grains = labelled > LABELLED * np.bincount(level.ravel(), minlength=count)
        with_grains |= labelled == labelled.max()
        kind = np.array([_NUMBER_OF.get(k, 3) for k in levels.kinds], np.int8)[level]
        near = ndimage.binary_dilation(labels > 0, iterations=SURFACE)
        kind[near & (kind == 3) & with_grains[level]] = 2
        kind[labels > 0] = 2
        level[(kind == 2) & ~with_grains[level]] = labelled.argmax()
        both = (level * len(PHASE_KINDS) + kind).ravel()
        sizes = np.bincount(both, minlength=count * len(PHASE_KINDS)).reshape(count, -1)
        for k in np.flatnonzero((sizes[:, 3] > 0) & (sizes[:, 3] < MIN_BODY_SHARE * array.size)):
            stray = (level == k) & (kind == 3)
            level[stray], kind[stray] = 0, 0
        key, index, voxels = np.unique(level * len(PHASE_KINDS) + kind, return_inverse=True, return_counts=True)
        phases = tuple(
            Phase(PHASE_KINDS[k % len(PHASE_KINDS)], float(levels.values[k // len(PHASE_KINDS)]), n / array.size)
            for k, n in zip(key.tolist(), voxels.tolist(), strict=True)
        )
        return cls(phases, index.reshape(array.shape).astype(np.int8))

    def where(self, kind: PhaseKind) -> Bools:
        """Voxels of all phases of a kind."""
        return np.asarray(np.array([phase.kind == kind for phase in self.phases])[self.index])


def find_phases(volume: Volume, labels: NDArray[np.integer], told: Sequence[PhaseSettings] = ()) -> PhaseMap | None:
    """What lies around the labelled grains of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) int array
        Grains, 0 for none.
    told : sequence of PhaseSettings
        Phases that are known; found if empty.

    Returns
    -------
    PhaseMap or None
        None if nothing but air and the grains' own level is found.

    Raises
    ------
    InputError
        If the labels are not the volume's.
    """
    labels = checked_labels(labels, volume.shape)
    grains = volume.array[labels > 0]
    threshold = float(grains.mean()) / 2 if len(grains) else float(threshold_otsu(volume.array))
    levels = find_levels(volume.array, threshold, told, beyond_field(volume))
    return None if levels is None else PhaseMap.of(volume.array, levels, labels)
