"""Bodies beside the grains, as arrays that kernels trace."""

from __future__ import annotations

import numpy as np

from grainmotion.kernels.layout import PADDING
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.scene import Body
from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays


def packed_body(body: Body) -> GrainArrays:
    """A body as one row that rotates about its centre of mass."""
    inner = body.volume.cropped(body.volume.array != 0)
    padded = Volume(np.pad(inner.array, PADDING), inner.voxel_size, inner.center)
    return GrainArrays.of(GrainSet((Grain(1, padded, body.center),)))
