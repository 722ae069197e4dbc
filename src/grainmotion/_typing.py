"""Shared type aliases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Index = NDArray[np.int64]
Image = NDArray[np.floating]
"""Line integrals and their derivatives, in the precision of the volume."""
Pixels = NDArray[np.floating | np.integer | np.bool_]
"""Pixels or voxels in the number type of the file that they come from."""
Beam = Literal["cone", "parallel"]
Kind = Literal["counts", "transmission", "line-integrals"]
"""What the pixels of radiographs are."""
Projector = Literal["trilinear", "exact"]
"""``"trilinear"``: the smooth image, sampled once a voxel; ``"exact"``: the exact radiological path of boxes."""
Progress = Callable[[str, int, int], None]
"""Called with a message, the units of work done and their total."""
