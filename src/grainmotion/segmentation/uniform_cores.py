"""Levels of attenuation in a volume, found in the insides of bodies.

Blur gives a voxel at the surface of a dense grain any attenuation between the grain's and the air's, so the histogram
of a whole volume has no clear peak for a liquid or a faint material.  Voxels whose neighbourhood is uniform are left:
the insides of bodies, one connected *core* in each, and of their histogram each peak is a phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.large_arrays import large_zeros
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.border import BeyondField
from grainmotion.segmentation.components import Components
from grainmotion.segmentation.level_codes import level_codes
from grainmotion.segmentation.percentiles import median

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

MIN_CORE_VOXELS = 20
"""Voxels of the smallest core that makes a phase."""
IN_NO_CORE = 255
"""Code of uniform voxels that are in no core."""


@dataclass(frozen=True, eq=False)
class UniformCores:
    """Cores 1 … n of a volume and their levels.

    Attributes
    ----------
    components : Components
        Connected uniform voxels of one level, some too small to be a core.
    numbers : (components,) int32 array
        The core that each component is, 0 for none.
    level_of : (n + 1,) int array
        Number of the level of each core, 0 for the lowest; entry 0 is not used.
    levels : (k,) array
        Median attenuation of each level, rising, 1/mm; the first is air, or the liquid that fills all.
    noise : float
        Range of 27 smoothed neighbours that noise alone causes, 1/mm.
    told : tuple of int
        Of each level the number of the phase that was told.
    blurred : bool
        Whether there are gaps between layers of grains that the scan blurs; they are no cores.
    """

    components: Components
    numbers: Ints
    level_of: NDArray[np.intp]
    levels: NDArray[np.float64]
    noise: float
    told: tuple[int, ...] = ()
    blurred: bool = False

    @classmethod
    def of(
        cls,
        array: Floats,
        threshold: float,
        told: Sequence[tuple[float, float]] = (),
        beyond: BeyondField | None = None,
        work: Work | None = None,
    ) -> UniformCores:
        """The uniform cores of a volume.

        Parameters
        ----------
        array : (nz, ny, nx) array
            Attenuation, 1/mm.
        threshold : float
            Attenuation that separates bodies from air roughly, as Otsu's does, 1/mm.
        told : sequence of (float, float)
            Lowest and highest attenuation of each phase, 1/mm, if they are known.
        beyond : BeyondField, optional
            Voxels beyond the field of view.  Smeared attenuation lies there, so they make no level of their own.
        work : Work, optional
            Threads.

        Returns
        -------
        UniformCores
            With one level if nothing rises above air.
        """
        work = work or Work()
        codes, noise, blurred = level_codes(array, threshold, told, beyond, work)
        components = Components.of(codes, work)
        kept = components.sizes >= MIN_CORE_VOXELS
        order = np.flatnonzero(kept)[np.argsort(components.codes[kept], kind="stable")]
        numbers = np.zeros(len(kept), np.int32)
        numbers[order] = 1 + np.arange(len(order))
        components.paint(codes, np.where(kept, 0, IN_NO_CORE).astype(np.uint8), work)
        found, level_of = np.unique(components.codes[order], return_inverse=True)
        levels = [median(work, array, codes, int(code)) for code in found]
        level_of = np.concatenate([[0], level_of]).astype(np.intp)
        phases = tuple(int(code) - 1 for code in found)
        return cls(components, numbers, level_of, np.array(levels), noise, phases, blurred)

    def labels(self, work: Work) -> Ints:
        """The core of each voxel, 0 for none."""
        labels = large_zeros(self.components.shape, np.int32)
        self.components.paint(labels, self.numbers, work)
        return labels
