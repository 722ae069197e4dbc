"""The surface of one grain to a fraction of a voxel, from its attenuation, or from labels alone.

From attenuation: marching cubes (Lewiner et al., J. Graphics Tools 8(2), 2003) at half of the grain's typical
attenuation.  A grain holds its own voxels alone, with zeros around them, so that its surface is closed where it
touches others; where grains were upsampled (``Grain.fine``), the boundary between touching grains is that of the
upsampled voxels, averaged back, so that it need not lie on faces of voxels.

Blur draws the half-level of a body with the mean curvature H inwards by σ² H, with σ² the variance of the blur along
one axis: a sphere of 20 voxels with sharp voxels lost 0.8 % of its volume, with a blur of one voxel 4 %.  Vertices are
moved outwards by that much.  σ comes from the partly filled voxels: Σ f (1 − f) over them is σ/√π for each unit of area
of a surface under Gaussian blur.  Marching cubes adds a constant of its own.  At last all vertices move by the same
distance, to where the attenuation about the surface balances (`mass_balance`).

From labels: the signed distance to the label's voxels, smoothed by one voxel, with the vertices moved along their
normals until the volume is that of the label's voxels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from edt import edt
from numpy.typing import NDArray
from scipy import ndimage
from skimage.measure import marching_cubes

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.analysis.deformed_volume import typical_attenuation
from grainmotion.errors import InputError
from grainmotion.grain_shapes.mass_balance import balancing_shift
from grainmotion.grain_shapes.triangle_mesh import Surface, largest_part
from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume

LABEL_SIGMA = 1.0
"""Width of the Gaussian filter of a label's signed distance, voxels."""
PARTLY_FILLED = (0.1, 0.9)
"""Shares of the typical attenuation between which a voxel counts as partly filled."""
MIN_PARTLY_FILLED = 0.05
"""Partly filled voxels, over voxels at the surface, below which the attenuation is taken for an image of labels."""
LEVEL_CLEARANCE = 1e-3
"""Least difference of a voxel from the level, over the range of values: no two vertices coincide."""
MARCHING_VARIANCE = 0.19
"""What linear interpolation and flat triangles add to the variance of the blur, voxels²: measured on spheres of 12 to
32 voxels under blurs of 0 to 1 voxel, where it was 0.14 to 0.20."""
CORE_DEPTH = 3
"""Depth from which the attenuation of a grain is that of its inside, voxels."""
CURVATURE_SIGMA = 1.5
"""Width of the Gaussian filter under which the curvature is determined, voxels."""
MAX_CURVATURE = 0.25
"""Largest mean curvature that is corrected for, 1/voxel: that of a sphere of 8 voxels."""
MAX_BLUR_VARIANCE = 2.0
"""Largest variance of the blur that is corrected for, voxels²."""
MIN_SURFACE_VOXELS = 8
"""Voxels of the smallest grain that has a surface."""

Source = Literal["attenuation", "labels"]


@dataclass(frozen=True, eq=False, repr=False)
class GrainSurface(Surface):
    """The closed surface of one grain in the reference state, mm, sample frame.

    Attributes
    ----------
    vertices, faces : array
        As of `Surface`.
    voxel_size : float
        Edge of the voxels from which it was made, mm.
    source : {"attenuation", "labels"}
        Whether grey values or labels alone give the surface.
    other_pieces : float
        Volume of loose pieces of the grain that are left out, over that of the whole.

    Examples
    --------
    >>> surface = gm.grain_surface(grains.grains[0])
    >>> surface.vertices.shape[1], surface.euler_characteristic
    (3, 2)
    """

    voxel_size: float = 1.0
    source: Source = "attenuation"
    other_pieces: float = 0.0


@checked_arguments
def grain_surface(grain: Grain) -> GrainSurface:
    """Closed surface of a grain, where its attenuation falls to half and balances, to a fraction of a voxel.

    Parameters
    ----------
    grain : Grain
        One of a `GrainSet`; grains that `track` uses are fine.

    Returns
    -------
    GrainSurface
        Triangles of about half a voxel, facing outwards; cavities are filled and loose pieces left out.  Where the
        attenuation is an image of labels (hardly a voxel partly filled) the surface is that of `label_surface`.

    Raises
    ------
    InputError
        If the grain has too few voxels.

    Examples
    --------
    >>> surface = gm.grain_surface(grains.grains[0])
    >>> surface.euler_characteristic  # closed, without holes
    2
    """
    where, volume = f"grain {grain.label}", _averaged(grain)
    typical = _level_of_core(volume.array, typical_attenuation(grain))
    inside = volume.array > typical / 2
    _check_size(inside, where)
    shell = inside & ~ndimage.binary_erosion(inside)
    low, high = (share * typical for share in PARTLY_FILLED)
    partly = (volume.array > low) & (volume.array < high)
    if np.count_nonzero(partly) < MIN_PARTLY_FILLED * np.count_nonzero(shell):
        return _from_labels(inside, volume, where)
    inside = ndimage.binary_fill_holes(inside)
    measured = volume.array.astype(float) / typical
    share = np.where(ndimage.binary_erosion(inside), 1.0, measured)  # dense and light parts inside make no difference
    field = np.clip(share, np.where(inside, 0.5 + LEVEL_CLEARANCE, 0), 1)
    surface = _marched(field, 0.5, volume, where, "attenuation")
    variance = _blur_variance(share, surface.area / volume.voxel_size**2)
    normals, curvature = _shape_at(field, surface.vertices, volume)
    amounts = (variance + MARCHING_VARIANCE) * volume.voxel_size * curvature
    surface = replace(surface, vertices=surface.vertices + amounts[:, None] * normals)
    distance = balancing_shift(measured, inside, surface, normals, volume, variance**0.5) * volume.voxel_size
    return replace(surface, vertices=surface.vertices + distance * normals)


@checked_arguments
def label_surface(labels: NDArray[np.integer], label: int, grid: Volume) -> GrainSurface:
    """Closed surface of a label, smoothed by a voxel, with the volume of its voxels.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        0 for no grain.
    label : int
        The grain.
    grid : Volume
        Voxel size and place of the labels; its values are not used.

    Returns
    -------
    GrainSurface
        Triangles of about half a voxel, facing outwards.

    Raises
    ------
    InputError
        If labels and grid differ in shape, or the label has too few voxels.

    Examples
    --------
    >>> surface = gm.label_surface(labels, 1, volume)
    >>> surface.source
    'labels'
    """
    if labels.shape != grid.shape:
        raise InputError("labels", f"shape {labels.shape} is not the grid's {grid.shape}", "give one a voxel")
    return _from_labels(labels == label, grid, f"label {label}")


def _from_labels(inside: NDArray[np.bool_], grid: Volume, where: str) -> GrainSurface:
    """Surface of a mask."""
    _check_size(inside, where)
    box = ndimage.find_objects(inside.astype(np.uint8))[0]
    mask = np.pad(ndimage.binary_fill_holes(inside[box]), 3)
    depth = np.asarray(edt(mask.astype(np.uint8)), dtype=float)
    height = np.asarray(edt((~mask).astype(np.uint8)), dtype=float)
    field = ndimage.gaussian_filter(np.where(mask, depth - 0.5, 0.5 - height), LABEL_SIGMA)
    count = int(mask.sum())
    level = float(np.partition(field.ravel(), -count - 1)[-count - 1])
    start = grid.origin + grid.voxel_size * (np.array([s.start for s in box[::-1]]) - 3)
    middle = start + grid.voxel_size * (np.array(mask.shape[::-1]) - 1) / 2
    place = Volume(np.zeros(mask.shape, np.float32), grid.voxel_size, (middle[0], middle[1], middle[2]))
    surface = _marched(field, level, place, where, "labels")
    missing = count * grid.voxel_size**3 - surface.volume
    normals, _ = _shape_at(field, surface.vertices, place)
    return replace(surface, vertices=surface.vertices + missing / surface.area * normals)


def _level_of_core(values: NDArray[np.floating], typical: float) -> float:
    """The median attenuation deeper inside than blur reaches, 1/mm; the typical one if the grain is too thin."""
    core = ndimage.binary_erosion(values > typical / 2, iterations=CORE_DEPTH)
    return float(np.median(values[core])) if np.count_nonzero(core) >= MIN_SURFACE_VOXELS else typical


def _blur_variance(share: Float, area: float) -> float:
    """Variance of the blur along one axis, voxels², from shares of filled voxels and the surface's area, voxels².

    Twice the outer half is taken, since the inner one holds the grain's texture.  Shares are not clipped, so that noise
    outside adds up to nothing.
    """
    outer = share[share < 0.5]
    total = 2 * max(float((outer * (1 - outer)).sum()), 0.0)
    return min(np.pi * (total / area) ** 2, MAX_BLUR_VARIANCE)


def _shape_at(field: Float, vertices: Float, grid: Volume) -> tuple[Float, Float]:
    """Outward normals ``(n, 3)`` of the smoothed body at vertices, and its mean curvature, 1/voxel, positive if convex.

    Normals of triangles would turn slivers over when vertices are moved along them.
    """
    smooth = ndimage.gaussian_filter(np.pad(field, 3, mode="edge"), CURVATURE_SIGMA)
    gradient = np.array(np.gradient(smooth))
    normal = -gradient / np.maximum(np.linalg.norm(gradient, axis=0), 1e-9)
    divergence = sum(np.gradient(normal[k], axis=k) for k in range(3))
    places = ((vertices - grid.origin)[:, ::-1] / grid.voxel_size + 3).T
    sampled = [ndimage.map_coordinates(part, places, order=1, mode="nearest") for part in (*normal[::-1], divergence)]
    outward = np.stack(sampled[:3], axis=1)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    return outward, np.clip(sampled[3] / 2, -MAX_CURVATURE, MAX_CURVATURE)


def _marched(field: Float, level: float, grid: Volume, where: str, source: Source) -> GrainSurface:
    """The largest closed surface at a level of a field, which is higher inside."""
    clear = LEVEL_CLEARANCE * (field.max() - level)
    field = np.where(np.abs(field - level) < clear, level - clear, field)
    field = np.pad(field, 1, constant_values=field.min())
    try:
        points, faces, _, _ = marching_cubes(field, level, allow_degenerate=True)
    except (ValueError, RuntimeError) as error:
        raise InputError(where, f"it has no surface ({error})", "leave it out") from error
    vertices = grid.origin + grid.voxel_size * (points[:, ::-1].astype(float) - 1)
    faces = faces.astype(np.int64)
    a, b, c = (vertices[faces] - vertices.mean(axis=0)).transpose(1, 0, 2)
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
        faces = faces[:, ::-1]
    vertices, faces, others = largest_part(vertices, faces)
    try:
        return GrainSurface(vertices, faces, grid.voxel_size, source, others)
    except InputError as error:
        raise InputError(
            where, f"its surface is not closed: {error.fact}", "smooth its labels, or leave it out"
        ) from error


def _averaged(grain: Grain) -> Volume:
    """The grain on voxels of the reference's size; its upsampled voxels averaged where there are such."""
    fine = grain.fine_volume
    if fine is None:
        return grain.coarse_volume
    k = round(grain.volume.voxel_size / fine.voxel_size)
    if k < 2:
        return fine
    missing = [-n % k for n in fine.shape]
    array = np.pad(fine.array, [(0, m) for m in missing])
    nz, ny, nx = (n // k for n in array.shape)
    mean = array.reshape(nz, k, ny, k, nx, k).mean(axis=(1, 3, 5))
    size = k * fine.voxel_size
    start = fine.origin + fine.voxel_size * (k - 1) / 2
    middle = start + size * (np.array(mean.shape[::-1]) - 1) / 2
    return Volume(mean, size, (middle[0], middle[1], middle[2]))


def _check_size(inside: NDArray[np.bool_], where: str) -> None:
    count = int(np.count_nonzero(inside))
    if count < MIN_SURFACE_VOXELS:
        raise InputError(where, f"it has {count} voxels", f"a surface needs {MIN_SURFACE_VOXELS}: leave it out")
