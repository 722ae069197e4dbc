"""Surfaces of the bodies beside the grains, such as pistons and a container's wall, for the page.

A body is where its attenuation, smoothed, is above half of what it typically is.  The surface is that of marching cubes
on a grid of at most `CELLS` cells a side, then edge collapses.  A wall thinner than a cell is drawn two cells
thick, a fiftieth of its width.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.measure import marching_cubes

from grainmotion._typing import Float
from grainmotion.model.scene import Body
from grainmotion.model.volume import Volume
from grainmotion.report.surfaces import Meshes, block_means, signed_volume, simplified

BODY_TRIANGLES = 2000
"""Most triangles of a body."""
CELLS = (96, 48, 24, 12, 6, 3)
"""Cells along each side of a body's box: the first of which few enough triangles can be made."""
BODY_SIGMA = 0.5
"""Width of the Gaussian filter, cells."""
MARGIN = 3  # empty cells around the body


def body_meshes(bodies: Sequence[Body]) -> Meshes:
    """Surfaces of bodies in their places of the reference, relative to their centres of mass."""
    return Meshes.packed([_surface(body) for body in bodies])


def _surface(body: Body) -> tuple[Float, NDArray[np.int64]] | None:
    """Vertices relative to the centre, mm, and triangles; None where nothing attenuates."""
    for cells in CELLS:
        marched = _marched(body.volume, cells)
        if marched is None:
            return None
        points, faces = simplified(*marched, BODY_TRIANGLES)
        if len(faces) <= BODY_TRIANGLES:
            break
    places = np.asarray(points, dtype=float) + (body.volume.origin - body.center)
    order = 1 if signed_volume(places, faces) > 0 else -1
    return places, faces[:, ::order].astype(np.int64)


def _marched(volume: Volume, cells: int) -> tuple[Float, NDArray[np.integer]] | None:
    """Vertices from the volume's first voxel, mm, x y z, and triangles on a grid of so many cells a side."""
    blocks = [max(1, -(-n // cells)) for n in volume.shape]
    layers = range(0, volume.shape[0], blocks[0])  # one by one: a copy of the whole body could be large
    means = [block_means(np.maximum(volume.array[z : z + blocks[0]], 0), blocks) for z in layers]
    field = ndimage.gaussian_filter(np.pad(np.concatenate(means), MARGIN), BODY_SIGMA, truncate=3)
    if not field.max() > 0:
        return None
    typical = float(np.average(field, weights=field**2))  # of the inside: edges and noise weigh little
    points, faces, _, _ = marching_cubes(field, typical / 2, allow_degenerate=False)
    return volume.voxel_size * ((points[:, ::-1] - MARGIN + 0.5) * blocks[::-1] - 0.5), faces
