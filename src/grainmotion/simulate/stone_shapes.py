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
from numpy.typing import ArrayLike, NDArray
from scipy.special import sph_harm_y

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.simulate.polyhedra import icosphere, resized
from grainmotion.simulate.shapes import Mesh


@dataclass(frozen=True, eq=False)
class StoneShapes:
    """Coefficients a_nm ``(stones, 378)``, mm, their degrees n and orders m ``(378,)``, and the stones' names."""

    names: tuple[str, ...]
    degrees: NDArray[np.int64]
    orders: NDArray[np.int64]
    coefficients: NDArray[np.complex128]

    def __len__(self) -> int:
        return len(self.names)


@lru_cache(maxsize=1)
def read_stone_shapes() -> StoneShapes:
    """Load the 95 gravel stones that ship with the package."""
    source = resources.files("grainmotion") / "data" / "fdot57.npz"
    with source.open("rb") as stream, np.load(stream) as data:
        return StoneShapes(
            names=tuple(str(name) for name in data["names"]),
            degrees=data["degrees"].astype(np.int64),
            orders=data["orders"].astype(np.int64),
            coefficients=data["real"].astype(float) + 1j * data["imag"].astype(float),
        )


@checked_arguments
def stone_radius(stone: int, directions: ArrayLike) -> Float:
    """Radius r(θ, φ) of one FDOT-57 stone about its centre of mass.

    Parameters
    ----------
    stone : int
        0 to 94: which of the stones.
    directions : (m, 3) array_like
        Unit vectors.

    Returns
    -------
    (m,) array
        Distance from the centre of mass to the surface along each direction, mm.

    Examples
    --------
    >>> gm.simulate.stone_radius(3, np.eye(3)).shape  # along x, y and z
    (3,)
    """
    return _basis(np.asarray(directions, dtype=float)) @ _real_coefficients(stone)


@checked_arguments
def stone(index: int, diameter: float | None = None, level: int = 4) -> Mesh:
    """A real gravel stone about its own centre of mass.

    Parameters
    ----------
    index : int
        0 to 94: which of the FDOT-57 stones (see `grainmotion.simulate.stone_shapes`).
    diameter : float, optional
        Diameter of the sphere of the same volume, mm; the stone's own size (12–20 mm) if None.
    level : int
        Subdivisions of the icosahedron that carries it: 4 gives 5,120 triangles, 5 gives 20,480.

    Returns
    -------
    Mesh
        The stone, its centre of mass at the origin.

    Raises
    ------
    InputError
        If there is no such stone, or the diameter is not positive.

    Examples
    --------
    >>> stone = gm.simulate.stone(3, 2.0, 3)
    >>> round(stone.volume, 1)
    4.2
    """
    directions, faces = icosphere(level)
    mesh = Mesh((_level_basis(level) @ _real_coefficients(index))[:, None] * directions, faces, np.zeros(3))
    mesh = mesh.moved(np.eye(3), -mesh.centroid)
    return mesh if diameter is None else resized(mesh, diameter)


def _basis(directions: Float) -> Float:
    """Real design matrix ``(m, 2·378)``: Re and −Im of the stored harmonics, m > 0 counted twice."""
    shapes = read_stone_shapes()
    theta = np.arccos(np.clip(directions[:, 2], -1, 1))
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    twice = np.where(shapes.orders > 0, 2.0, 1.0)
    y = sph_harm_y(shapes.degrees, shapes.orders, theta[:, None], phi[:, None]) * twice
    return np.concatenate([y.real, -y.imag], axis=1)


@lru_cache(maxsize=3)
def _level_basis(level: int) -> NDArray[np.float32]:
    return _basis(icosphere(level)[0]).astype(np.float32)


def _real_coefficients(index: int) -> Float:
    shapes = read_stone_shapes()
    if not 0 <= index < len(shapes):
        raise InputError("stone", f"index {index} is not 0 to {len(shapes) - 1}", "choose one of the shapes")
    a = shapes.coefficients[index]
    return np.concatenate([a.real, a.imag])
