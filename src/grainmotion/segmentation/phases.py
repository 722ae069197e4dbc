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

from grainmotion.model.large_arrays import large_empty
from grainmotion.model.volume import Volume
from grainmotion.segmentation.blocks import Block, Work, blocks_of
from grainmotion.segmentation.border import BeyondField, beyond_field
from grainmotion.segmentation.distance_basins import nearest_codes
from grainmotion.segmentation.label_measures import looked_up
from grainmotion.segmentation.labels import checked_labels
from grainmotion.segmentation.level_kinds import Neighbours, inclusion_hosts, liquid_levels
from grainmotion.segmentation.level_map import flooded, without_shells
from grainmotion.segmentation.settings import PhaseKind, PhaseSettings
from grainmotion.segmentation.uniform_cores import UniformCores

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]

PASSES_OF_A_LIQUID = 60
"""Passes through a volume in which it is found out whether a level is a liquid, about."""
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
    blurred : bool
        Whether there are blurred gaps between layers of grains besides.
    """

    values: NDArray[np.float64]
    kinds: tuple[str, ...]
    of_voxel: NDArray[np.int8]
    blurred: bool = False

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

    def around(self, work: Work) -> NDArray[np.int8]:
        """Number of the level of the air or liquid nearest to each voxel."""
        if not self.has_liquid:
            return np.broadcast_to(np.int8(0), self.of_voxel.shape)
        return nearest_codes(self.of_voxel, ~self.is_solid(), work)


def find_levels(
    array: Floats,
    threshold: float,
    told: Sequence[PhaseSettings] = (),
    beyond: BeyondField | None = None,
    work: Work | None = None,
) -> tuple[Levels | None, bool]:
    """Levels of a volume, and whether gaps between layers of grains are blurred in it.

    Parameters
    ----------
    array : (nz, ny, nx) array
        Attenuation, 1/mm.
    threshold : float
        Attenuation that separates bodies from air roughly, as Otsu's does, 1/mm.
    told : sequence of PhaseSettings
        Phases that are known; found if empty.  Air without attenuation is added unless it is told.
    beyond : BeyondField, optional
        Voxels beyond the field of view, which make no level of their own.
    work : Work, optional
        Threads.

    Returns
    -------
    levels : Levels or None
        None if there are no two levels above the lowest, so that one threshold separates all there is.
    blurred : bool
        See `blurred_gaps`; such gaps are no level.
    """
    if told and all(phase.kind != "air" for phase in told):
        told = (PhaseSettings("air", 0.0), *told)
    work = work or Work()
    cores = UniformCores.of(array, threshold, [phase.bounds for phase in told], beyond, work)
    if len(cores.levels) < 3 and not told:
        return None, cores.blurred
    work.begin("places of the levels", 45, 10)
    regions, count, own = flooded(array, cores, work), len(cores.levels), cores.level_of
    neighbours = Neighbours.of(regions, len(own) - 1, work)
    hosts = own if told else inclusion_hosts(cores, neighbours)
    kinds_of = np.unique(own * count + hosts, return_inverse=True)
    number = np.min_scalar_type(len(kinds_of[0]))
    both = looked_up(kinds_of[1].astype(number), regions, work)  # of each voxel its own level and its host's
    del regions
    own, hosts = np.divmod(kinds_of[0], count)
    if told:
        kinds, level_of = tuple(str(told[k].kind) for k in cores.told), own
    else:
        work.begin("liquids", 60, PASSES_OF_A_LIQUID * (count - 2))
        liquid = liquid_levels(array, looked_up(own.astype(np.int8), both, work), cores.levels, work)
        kinds = tuple("air" if k == 0 else "liquid" if k in liquid else "solid" for k in range(count))
        level_of = np.where(np.isin(hosts, (0, *liquid)), own, hosts)  # an inclusion in a solid belongs to it
    of_voxel = looked_up(level_of.astype(np.int8), both, work)
    del both
    of_voxel = without_shells(array, of_voxel, cores.levels, work)
    return Levels(cores.levels, kinds, of_voxel, cores.blurred), cores.blurred


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

    def where(self, kind: PhaseKind) -> Bools:
        """Voxels of all phases of a kind."""
        return np.asarray(np.array([phase.kind == kind for phase in self.phases])[self.index])


def phase_map(array: Floats, levels: Levels, labels: NDArray[np.int32], work: Work) -> PhaseMap:
    """Phases by levels and the labels of the grains; solids without a label are bodies."""
    count, blocks = len(levels.values), blocks_of(array.shape)
    kinds = np.array([_NUMBER_OF.get(k, 3) for k in levels.kinds], np.int8)

    def count_levels(block: Block, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        level = levels.of_voxel[block.box].astype(np.intp) + count * (labels[block.box] > 0)
        return counts + np.bincount(level.ravel(), minlength=2 * count)

    counts = sum(work.gathered(blocks, lambda: np.zeros(2 * count, np.int64), count_levels))
    labelled = np.asarray(counts)[count:]
    with_grains = labelled > LABELLED * (labelled + np.asarray(counts)[:count])
    with_grains |= labelled == labelled.max()
    index = large_empty(array.shape, np.int8)

    def fill(block: Block, sizes: NDArray[np.int64]) -> NDArray[np.int64]:
        wide = block.gather(labels, SURFACE, 0, np.int32) > 0
        inner = (slice(SURFACE, -SURFACE),) * 3
        level, grain = levels.of_voxel[block.box].copy(), wide[inner]
        kind = kinds[level]
        kind[ndimage.binary_dilation(wide, iterations=SURFACE)[inner] & (kind == 3) & with_grains[level]] = 2
        kind[grain] = 2
        level[(kind == 2) & ~with_grains[level]] = labelled.argmax()
        code = level * np.int8(len(PHASE_KINDS)) + kind
        index[block.box] = code
        return sizes + np.bincount(code.ravel(), minlength=len(sizes))

    sizes = np.asarray(sum(work.gathered(blocks, lambda: np.zeros(count * len(PHASE_KINDS), np.int64), fill)))
    new = np.arange(len(sizes))
    stray = (sizes > 0) & (sizes < MIN_BODY_SHARE * array.size) & (new % len(PHASE_KINDS) == 3)
    new[stray] = 0
    sizes = np.bincount(new, sizes, minlength=len(sizes)).astype(np.int64)
    codes = np.flatnonzero(sizes)
    number = np.zeros(len(sizes), np.int8)
    number[codes] = np.arange(len(codes))
    number = number[new]
    work.each(blocks, lambda block: index.__setitem__(block.box, number[index[block.box]]))
    phases = tuple(
        Phase(PHASE_KINDS[k % len(PHASE_KINDS)], float(levels.values[k // len(PHASE_KINDS)]), sizes[k] / array.size)
        for k in codes.tolist()
    )
    return PhaseMap(phases, index)


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
    own, work = checked_labels(labels, volume.shape).astype(np.int32, copy=False), Work()
    grains = volume.array[own > 0]
    threshold = float(grains.mean()) / 2 if len(grains) else float(threshold_otsu(volume.array))
    levels, _ = find_levels(volume.array, threshold, told, beyond_field(volume), work)
    return None if levels is None else phase_map(volume.array, levels, own, work)
