"""How arrays that kernels trace are laid out in memory."""

from __future__ import annotations

PADDING = 2  # empty voxels kept around each grain, so that interpolation never leaves its crop
