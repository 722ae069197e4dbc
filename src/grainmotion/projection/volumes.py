"""Whole volumes to radiographs, and the exact adjoint."""

from __future__ import annotations

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Image, Projector
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator


@checked_arguments
def project(volume: Volume, geometry: Geometry, *, projector: Projector = "trilinear") -> Image:
    """Line integrals of a volume.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    geometry : Geometry
        Views to project to.
    projector : {"trilinear", "exact"}
        The smooth image, sampled once a voxel, or the exact path through box-shaped voxels (Siddon).

    Returns
    -------
    (views, rows, columns) array
        Line integrals, dimensionless, in the precision of the volume.

    Examples
    --------
    >>> images = gm.project(volume, case.scanner.geometry((0, 90)))
    >>> images.shape
    (2, 96, 72)
    """
    operator = VolumeOperator(geometry, volume, projector)
    return operator.forward(operator.padded(volume.array))


@checked_arguments
def back_project(images: Image, geometry: Geometry, grid: Volume, *, projector: Projector = "trilinear") -> Volume:
    """The exact adjoint of `project`: ⟨A x, y⟩ = ⟨x, Aᵀ y⟩.

    Parameters
    ----------
    images : (views, rows, columns) array
        Radiographs y.
    geometry : Geometry
        Their views.
    grid : Volume
        Where to project back; its values are not used, its precision is.
    projector : {"trilinear", "exact"}
        The projector A whose adjoint is taken.

    Returns
    -------
    Volume
        Aᵀ y on the grid, in the units of the images times mm.

    Raises
    ------
    InputError
        If the images are not those of the views.

    Examples
    --------
    >>> spread = gm.back_project(state.line_integrals, state.geometry, case.scanner.grid)
    >>> spread.shape
    (96, 72, 72)
    """
    wanted = (len(geometry), *geometry.shape)
    if np.shape(images) != wanted:
        fact = f"shape {np.shape(images)}, the geometry has {wanted}: views, rows, columns"
        raise InputError("images", fact, "give one image for each view, of the size of the panel")
    operator = VolumeOperator(geometry, grid, projector)
    image = operator.empty()
    operator.add_adjoint(images, image)
    return Volume(operator.unpadded(image), grid.voxel_size, grid.center)
