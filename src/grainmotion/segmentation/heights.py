"""Values of voxels that grains are separated by: an array, or what is computed from one block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.large_arrays import large_empty
from grainmotion.segmentation.blocks import Block, Work, blocks_of

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Heights:
    """Values of the voxels of a volume.

    Attributes
    ----------
    shape : tuple of int
        Of the volume.
    gather : callable
        Values of a block and of some voxels more on each side, 0 beyond the volume: ``gather(block, reach)``.
    array : array, optional
        The values, if they exist already.
    blurred : bool
        Whether layers of grains are blurred along z (`blurred_gaps`).
    """

    shape: tuple[int, ...]
    gather: Callable[[Block, int], Floats]
    array: NDArray[np.floating] | None = None
    blurred: bool = False

    @classmethod
    def of(cls, array: NDArray[np.floating], blurred: bool = False) -> Heights:
        """Those of an array."""
        return cls(array.shape, lambda block, reach: block.gather(array, reach, 0), array, blurred)

    def whole(self, work: Work) -> NDArray[np.floating]:
        """The values as an array, which is made each time: it takes 4 bytes a voxel."""
        if self.array is not None:
            return self.array
        out = large_empty(self.shape, np.float32)
        work.each(blocks_of(self.shape), lambda block: out.__setitem__(block.box, self.gather(block, 0)))
        return out
