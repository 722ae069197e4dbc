"""Whole volumes to radiographs, and the exact adjoint."""

from __future__ import annotations

from grainmotion._typing import Image, Projector
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator


# ---------------------------------------------------------------------- whole volumes
def project(volume: Volume, geometry: Geometry, *, projector: Projector = "trilinear") -> Image:
    """Line integrals of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    geometry : Geometry
        Views to project to.
    projector : {"trilinear", "exact"}
        See `Projector`.

    Returns
    -------
    (views, rows, columns) array
        Line integrals, dimensionless, in the precision of the volume.
    """
    operator = VolumeOperator(geometry, volume, projector)
    return operator.forward(operator.padded(volume.array))


def back_project(images: Image, geometry: Geometry, grid: Volume, *, projector: Projector = "trilinear") -> Volume:
    """The exact adjoint of `project`: ⟨A x, y⟩ = ⟨x, Aᵀ y⟩; place and precision are those of ``grid``."""
    operator = VolumeOperator(geometry, grid, projector)
    image = operator.empty()
    operator.add_adjoint(images, image)
    return Volume(operator.unpadded(image), grid.voxel_size, grid.center)
