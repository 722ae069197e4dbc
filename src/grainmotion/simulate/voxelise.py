"""Voxelisation of the exact sample, for tests of functions that work on voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.model.progress import counted
from grainmotion.model.volume import Volume
from grainmotion.simulate.sample import Sample
from grainmotion.simulate.shapes import Ellipsoid, Shape, extent
from grainmotion.simulate.signed_distance import locator, signed_distances


@checked_arguments
def inside(shape: Shape, points: Float) -> NDArray[np.bool_]:
    """Find the points that lie inside a shape.

    Parameters
    ----------
    shape : Mesh or Ellipsoid
        The solid.
    points : (m, 3) array
        mm, x y z.

    Returns
    -------
    (m,) bool array
        True inside the shape or on its surface.

    Examples
    --------
    >>> grain = case.sample.particles[0]
    >>> gm.simulate.inside(grain.shape, grain.center[None]).tolist()
    [True]
    """
    if isinstance(shape, Ellipsoid):
        return (((points - shape.center) @ shape.whitening.T) ** 2).sum(axis=1) <= 1
    body, origin = locator(shape)
    return signed_distances(body, points - origin) <= 0


@checked_arguments
def label_volume(sample: Sample, grid: Volume) -> NDArray[np.int16]:
    """Label each voxel by the particle that holds its centre.

    Parameters
    ----------
    sample : Sample
        Particles labelled 1 to n.
    grid : Volume
        The voxel grid; its values are not used.

    Returns
    -------
    (nz, ny, nx) int16 array
        Labels, 0 outside all particles.

    Examples
    --------
    >>> labels = gm.simulate.label_volume(case.sample, case.scanner.grid)
    >>> int(labels.max())
    4
    """
    out = np.zeros(grid.shape, np.int16)
    for label, particle in counted(zip(sample.labels, sample.particles, strict=True), len(sample.particles)):
        box, points = _points(particle.shape, grid, 1)
        out[box][inside(particle.shape, points).reshape(out[box].shape)] = label
    return out


@checked_arguments
def attenuation_volume(sample: Sample, grid: Volume, samples: int = 3) -> Volume:
    """Average the attenuation over each voxel; the tube is left out.

    Parameters
    ----------
    sample : Sample
        Particles and bodies with their inclusions.
    grid : Volume
        The voxel grid; its values are not used.
    samples : int
        Sampling points along each side of a voxel, ``samples`` cubed in all.

    Returns
    -------
    Volume
        Attenuation, 1/mm, on the same grid.

    Examples
    --------
    >>> gm.simulate.attenuation_volume(case.sample, case.scanner.grid).shape
    (96, 72, 72)
    """
    out = np.zeros(grid.shape)
    for particle in counted((*sample.particles, *sample.bodies)):
        for shape, value in particle.parts:
            box, points = _points(shape, grid, samples)
            nz, ny, nx = out[box].shape
            share = inside(shape, points).reshape(nz, samples, ny, samples, nx, samples).mean(axis=(1, 3, 5))
            out[box] += value * share
    return Volume(out.astype(np.float32), grid.voxel_size, grid.center)


def _points(shape: Shape, grid: Volume, samples: int) -> tuple[tuple[slice, slice, slice], Float]:
    """The part of the grid around a shape, and its sampling points ``(m, 3)``."""
    low, high = extent(shape, np.eye(3))
    limit = np.array(grid.shape[::-1])
    first = np.clip(np.floor((low - grid.origin) / grid.voxel_size), 0, limit).astype(int)
    last = np.clip(np.ceil((high - grid.origin) / grid.voxel_size) + 1, first, limit).astype(int)
    within = (np.arange(samples) + 0.5) / samples - 0.5
    x, y, z = (
        grid.origin[i] + grid.voxel_size * (np.arange(first[i], last[i])[:, None] + within).ravel() for i in range(3)
    )
    mesh = np.meshgrid(z, y, x, indexing="ij")
    points = np.stack([mesh[2].ravel(), mesh[1].ravel(), mesh[0].ravel()], axis=1)
    return (slice(first[2], last[2]), slice(first[1], last[1]), slice(first[0], last[0])), points
