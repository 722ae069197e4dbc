"""Levels that are none: the gaps between layers of grains, as a cone-beam scan blurs them along its axis.

A circular scan sees nothing of what varies along z alone more slowly across than the slope of its rays: far above and
below the source, where rays are inclined by α, the layers of a wide sample run into the gaps between them.  Where there
are many such gaps their voxels are as many as those of a faint phase.  But they lie in horizontal *sheets*, and their
attenuation is anything between that of air and of the grains, as the gaps are more or less wide.  A liquid has one
attenuation and fills pores of all directions; a faint plate is a sheet, of one attenuation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grainmotion.segmentation.blocks import Work, slabs_of

MAX_SHEET = 0.4
"""Mean length across a level's uniform parts along z, over that along x and y, of a sheet: 0.2 in blurred gaps, 0.35
in small ones under steep rays, 0.5 and more in liquids that surround grains."""
MIN_CONTINUUM = 0.5
"""Range of the middle 80 % of a level's attenuations, over their median, from which they are no level of their own:
0.8 and more in blurred gaps, up to 0.3 in liquids and 0.42 in faint plates, with noise."""


def is_blurred_gap(codes: NDArray[np.uint8], code: int, tenths: Sequence[float], work: Work) -> bool:
    """Whether the uniform voxels of a level are gaps between layers of grains that the scan blurs.

    Parameters
    ----------
    codes : (nz, ny, nx) uint8 array
        Number of each uniform voxel's level.
    code : int
        The level.
    tenths : three floats
        Attenuation above air below which a tenth, half and nine tenths of its voxels lie, 1/mm.
    work : Work
        Threads.
    """
    low, middle, high = tenths
    return high - low > MIN_CONTINUUM * middle and length_along_axis(codes, code, work) < MAX_SHEET


def length_along_axis(codes: NDArray[np.uint8], code: int, work: Work) -> float:
    """Mean length of the parts of a level along z over that along x and y: these have more surface across z if flat."""

    def count(slab: tuple[int, int]) -> tuple[int, int]:
        here, wide = codes[slice(*slab)] == code, codes[slab[0] : slab[1] + 1] == code
        across = np.count_nonzero(here[:, 1:] != here[:, :-1]) + np.count_nonzero(here[..., 1:] != here[..., :-1])
        return int(np.count_nonzero(wide[1:] != wide[:-1])), int(across)

    along, across = np.sum(work.each(slabs_of(codes.shape), count), axis=0)
    return float(across / max(2 * along, 1))
