"""Volume, centre and inertia of a closed surface, exactly, for a uniform density.

A tetrahedron of the origin and a triangle a, b, c has the volume V = a · (b × c)/6, the first moment
V (a + b + c)/4 and the second moment ∫ x xᵀ = V/20 (a aᵀ + b bᵀ + c cᵀ + s sᵀ) with s = a + b + c.  Their signed sums
over the surface are the moments of the solid (divergence theorem; Tonon, J. Math. Stat. 1(1), 2005).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.model.summary import Summarised


@dataclass(frozen=True, eq=False, repr=False)
class MassProperties(Summarised):
    """Mass properties of a solid of density 1 per mm³.

    Attributes
    ----------
    volume : float
        mm³; the mass at density 1.
    center : (3,) array
        Centre of the volume, mm, x y z.
    inertia : (3, 3) array
        Inertia tensor about the centre at density 1, mm⁵, in the frame of the surface.

    Examples
    --------
    >>> ball = gm.mass_properties(gm.grain_surface(grains.grains[0]))
    >>> ball.center.shape, ball.inertia.shape
    ((3,), (3, 3))
    """

    volume: float
    center: Float
    inertia: Float

    @classmethod
    def of_moments(cls, volume: float, center: Float, second: Float) -> MassProperties:
        """Mass properties from the second moments ∫ x xᵀ about the centre.

        Parameters
        ----------
        volume : float
            mm³.
        center : (3,) array
            mm.
        second : (3, 3) array
            mm⁵.

        Returns
        -------
        MassProperties
            With the inertia tensor (tr S) 1 − S.
        """
        return cls(volume, center, np.trace(second) * np.eye(3) - second)

    @property
    def principal_moments(self) -> Float:
        """Principal moments of inertia ``(3,)`` at density 1, mm⁵, the smallest first."""
        return np.asarray(np.linalg.eigvalsh(self.inertia), dtype=float)

    @property
    def principal_axes(self) -> Float:
        """Unit vectors of the principal axes in columns ``(3, 3)``, in the order of the moments: a rotation matrix.

        The largest component of the first two is positive, the third is their cross product.
        """
        axes = np.linalg.eigh(self.inertia)[1]
        largest = axes[np.abs(axes).argmax(axis=0), range(3)]
        axes = axes * np.sign(largest)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        return axes


@checked_arguments
def mass_properties(surface: Surface) -> MassProperties:
    """Volume, centre and inertia tensor of the solid in a closed surface.

    Parameters
    ----------
    surface : Surface
        Closed, facing outwards, mm.

    Returns
    -------
    MassProperties
        Exact for the polyhedron, at density 1 per mm³.

    Examples
    --------
    >>> body = gm.mass_properties(gm.grain_surface(grains.grains[0]))
    >>> body.principal_moments.shape
    (3,)
    """
    start = surface.vertices.mean(axis=0)  # near the solid, for the precision of the sums
    corners = surface.corners - start
    a, b, c = corners.transpose(1, 0, 2)
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    total = volumes.sum()
    sums = corners.sum(axis=1)
    middle = volumes @ sums / 4 / total
    second = np.einsum("i,ikp,ikq->pq", volumes, corners, corners) + np.einsum("i,ip,iq->pq", volumes, sums, sums)
    second = second / 20 - total * np.outer(middle, middle)
    return MassProperties.of_moments(float(total), start + middle, second)
