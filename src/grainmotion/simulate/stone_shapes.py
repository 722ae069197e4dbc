"""Real gravel shapes: spherical-harmonic coefficients of the 95 stones of FDOT-57, shipped with the package.

The surface of a stone is r(θ, φ) = Σ a_nm Y_nm(θ, φ), in mm about its centre of mass, with the
orthonormal complex Y_nm of `scipy.special.sph_harm_y` up to degree 26.  r is real, so that
a_n,−m = (−1)^m conj(a_nm) and only m ≥ 0 is stored.  See ``data/README.md`` for source and licence.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

DEGREE = 26


@dataclass(frozen=True, eq=False)
class StoneShapes:
    """Spherical-harmonic coefficients of a family of stones.

    Attributes
    ----------
    names : tuple of str
        Name of each stone, as in the source, for instance ``"A-anm-00001"``.
    degrees, orders : (378,) int arrays
        n and m ≥ 0 of each coefficient.
    coefficients : (stones, 378) complex array
        a_nm, mm.
    """

    names: tuple[str, ...]
    degrees: NDArray[np.int64]
    orders: NDArray[np.int64]
    coefficients: NDArray[np.complex128]

    def __len__(self) -> int:
        return len(self.names)


@lru_cache(maxsize=1)
def read_stone_shapes() -> StoneShapes:
    """The 95 gravel stones that ship with the package."""
    source = resources.files("grainmotion") / "data" / "fdot57.npz"
    with source.open("rb") as stream, np.load(stream) as data:
        return StoneShapes(
            names=tuple(str(name) for name in data["names"]),
            degrees=data["degrees"].astype(np.int64),
            orders=data["orders"].astype(np.int64),
            coefficients=data["real"].astype(float) + 1j * data["imag"].astype(float),
        )
