"""Real gravel shapes: spherical-harmonic coefficients of the 95 stones of FDOT-57, shipped with the package.

The surface of a stone is r(θ, φ) = Σ a_nm Y_nm(θ, φ), in mm about its centre of mass, with the
orthonormal complex Y_nm of `scipy.special.sph_harm_y` up to degree 26.  r is real, so that
a_n,−m = (−1)^m conj(a_nm) and only m ≥ 0 is stored.  See ``data/README.md`` for source and licence.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path

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


def pack_stone_shapes(folder: Path, target: Path) -> None:
    """Pack the source's ``*-anm-*.dat`` files (rows n, m, Re, Im) into the file that the package ships."""
    files = sorted(folder.glob("*-anm-*.dat"))
    tables = [np.loadtxt(f) for f in files]
    n, m = tables[0][:, 0].astype(int), tables[0][:, 1].astype(int)
    keep = m >= 0
    np.savez_compressed(
        target,
        names=np.array([f.stem for f in files]),
        degrees=n[keep].astype(np.int16),
        orders=m[keep].astype(np.int16),
        real=np.array([t[keep, 2] for t in tables], dtype=np.float32),
        imag=np.array([t[keep, 3] for t in tables], dtype=np.float32),
    )
