"""Products of what lies in the patches of grains, added up grain by grain."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.kernels import normal_equations
from grainmotion.projection.footprints import Patches


def products_by_grain(left: Image, right: Image, patches: Patches) -> Float:
    """Sums ``(n, k, m)`` over each grain's patches of ``left (k, pixels)`` times ``right (m, pixels)``."""
    out = np.empty((len(patches.seen), len(left), len(right)))
    normal_equations.dots(left, right, patches.grain_offsets, out)
    return out
