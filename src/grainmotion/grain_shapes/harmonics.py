"""Real spherical harmonics of a star-shaped surface: r(θ, φ) = Σ a_lm Y_lm(θ, φ) about its centre.

Y_l0 is the usual zonal harmonic, Y_lm = √2 N P_l^m(cos θ) cos mφ and Y_l,−m = √2 N P_l^m(cos θ) sin mφ for m > 0, with
∫ Y² dΩ = 1 and no Condon–Shortley phase; θ from +z, φ from +x towards +y.  A sphere of radius R has a_00 = R √(4π).
The coefficients are those of the least squared difference over the sphere of directions (each vertex with its share of
the solid angle).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import sph_harm_y

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.grain_shapes.mass_properties import mass_properties
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.model.summary import Summarised

MAX_OVERHANG = 0.005
"""Share of all directions in which a star-shaped surface may be seen more than once: steps of voxels."""
MAX_DEGREE = 40


@dataclass(frozen=True, eq=False, repr=False)
class Harmonics(Summarised):
    """Expansion of a surface in real spherical harmonics.

    Attributes
    ----------
    coefficients : ((degree + 1)²,) array
        a_lm, mm, in the order l = 0, 1, … and m = −l … l; NaN if the surface is not star-shaped.
    center : (3,) array
        Point from which radii are measured, mm.
    overhang : float
        Share of all directions in which the surface is met more than once: 0 for a star-shaped one.
    residual, worst : float
        Root mean square and largest difference of the radii, mm.

    Examples
    --------
    >>> shape = gm.harmonics(gm.grain_surface(grains.grains[0]), degree=6)
    >>> shape.degree, shape.coefficients.shape
    (6, (49,))
    """

    coefficients: Float
    center: Float
    overhang: float
    residual: float
    worst: float

    @property
    def degree(self) -> int:
        """Largest degree l."""
        return round(len(self.coefficients) ** 0.5) - 1

    @property
    def star_shaped(self) -> bool:
        """Whether the surface is one radius in each direction, so that the coefficients mean anything."""
        return self.overhang <= MAX_OVERHANG

    def radius(self, directions: ArrayLike) -> Float:
        """Radius of the expansion in directions ``(m, 3)``, mm.

        Parameters
        ----------
        directions : (m, 3) array_like
            Of any length.

        Returns
        -------
        (m,) array
            mm.
        """
        return _basis(np.asarray(directions, dtype=float), self.degree) @ self.coefficients


def orders(degree: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Degrees l and orders m of the coefficients up to a degree, in their order."""
    degrees = np.repeat(np.arange(degree + 1), 2 * np.arange(degree + 1) + 1)
    return degrees, np.arange(len(degrees)) - degrees * (degrees + 1)


@checked_arguments
def harmonics(surface: Surface, degree: int = 12) -> Harmonics:
    """Expand a star-shaped surface in real spherical harmonics about the centre of its volume.

    Parameters
    ----------
    surface : Surface
        Closed, facing outwards, mm.
    degree : int
        Largest degree, 0 to 40: features of the size of the grain's girth over the degree are resolved.

    Returns
    -------
    Harmonics
        With what the expansion misses.  Of a surface that is not star-shaped the coefficients are NaN, and
        ``overhang`` says by how much.

    Raises
    ------
    InputError
        If the degree is out of range, or too large for the number of vertices.

    Examples
    --------
    >>> shape = gm.harmonics(gm.grain_surface(grains.grains[0]), degree=6)
    >>> shape.star_shaped
    True
    """
    count = (degree + 1) ** 2
    if not 0 <= degree <= MAX_DEGREE or 2 * count > len(surface.vertices):
        fact = f"degree {degree} has {count} coefficients, the surface {len(surface.vertices)} vertices"
        raise InputError("harmonics.degree", fact, f"give 0 to {MAX_DEGREE}, at most half as many coefficients")
    center = mass_properties(surface).center
    points = surface.vertices - center
    solid = _solid_angles(points[surface.faces])
    overhang = float(-solid[solid < 0].sum() / (4 * np.pi))
    # a centre outside the solid sees 0 solid angle in all
    if overhang > MAX_OVERHANG or abs(solid.sum() - 4 * np.pi) > 1:
        nothing = np.full(count, np.nan)
        return Harmonics(nothing, center, max(overhang, 2 * MAX_OVERHANG), float("nan"), float("nan"))
    shares = np.bincount(surface.faces.ravel(), np.repeat(np.abs(solid) / 3, 3), minlength=len(points))
    radii = np.linalg.norm(points, axis=1)
    basis = _basis(points, degree)
    weighted = basis * shares[:, None]  # nearly orthonormal, so that the normal equations lose no digits
    coefficients = np.linalg.solve(weighted.T @ basis, weighted.T @ radii)
    gap = radii - basis @ coefficients
    rms = float(np.sqrt((shares * gap**2).sum() / shares.sum()))
    return Harmonics(coefficients, center, overhang, rms, float(np.abs(gap).max()))


def _basis(directions: Float, degree: int) -> Float:
    """Values of the harmonics in directions ``(m, (degree + 1)²)``."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    theta, phi = np.arccos(np.clip(unit[:, 2], -1, 1)), np.arctan2(unit[:, 1], unit[:, 0])
    n, m = orders(degree)
    half = m >= 0
    y = sph_harm_y(n[half], m[half], theta[:, None], phi[:, None])
    scale = np.where(m[half] == 0, 1, np.sqrt(2)) * (-1.0) ** m[half]
    basis = np.empty((len(unit), len(n)))
    basis[:, half] = scale * y.real
    center = n * (n + 1)  # place of (l, 0)
    positive = m > 0
    basis[:, (center - m)[positive]] = (scale * y.imag)[:, m[half] > 0]
    return basis


def _solid_angles(corners: Float) -> Float:
    """Signed solid angles of triangles ``(m, 3, 3)`` seen from the origin (Van Oosterom and Strackee, 1983)."""
    a, b, c = corners.transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(p, axis=1) for p in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return 2 * np.arctan2(above, la * lb * lc + ab * lc + bc * la + ca * lb)
