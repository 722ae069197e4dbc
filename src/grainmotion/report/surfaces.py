"""Surfaces of all grains for the page: few triangles a grain, so that thousands of grains turn smoothly and fit in.

A grain's label is averaged onto a coarse grid and smoothed; marching cubes at the level that keeps the volume (Lewiner
et al., J. Graphics Tools 8(2), 2003) and quadric edge collapses (Garland & Heckbert, SIGGRAPH 1997) make its triangles.
They are for looking: `grain_shapes.grain_surface` is exact to a fraction of a voxel, and takes a hundred times as long.

Beyond `MAX_MESHES` grains each is the ellipsoid with the label's second moments.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.measure import marching_cubes

from grainmotion._typing import Float
from grainmotion.model.progress import counted
from grainmotion.model.volume import Volume
from grainmotion.report.embedding import embed

MAX_TRIANGLES = 450_000
"""Triangles of all grains: 2.4 MB on the page; integrated graphics draw them many times in a thirtieth of a second
(validation/benchmarks/results/report_frames.md)."""
GRAIN_TRIANGLES = (60, 1600)
"""Fewest triangles with which a grain keeps its shape, and most that are worth it on a screen."""
MAX_MESHES = MAX_TRIANGLES // GRAIN_TRIANGLES[0]
MARCHED_SHARE = 2.0
"""Triangles of marching cubes over those that are kept."""
TRIANGLES_A_CELL = 6.6
"""Triangles that marching cubes makes of a ball of d cells, over d²: measured on balls of 8 to 30 cells."""
CELL_SIGMA = 0.7
"""Width of the Gaussian filter, cells."""
COORDINATE_STEPS = 2047
"""Steps of a coordinate from the grain's centre to its farthest vertex."""


@dataclass(frozen=True, eq=False)
class Meshes:
    """Closed surfaces of n grains or bodies, one after another.

    Attributes
    ----------
    vertices : (m, 3) int array
        Relative to the centre of each, in steps of its scale, x y z.
    triangles : (k, 3) int array
        Its own vertices, counted from 0, counter-clockwise seen from outside.
    scales : (n,) array
        mm a step.
    vertex_counts, triangle_counts : (n,) int arrays
        0 for those without a surface.
    """

    vertices: NDArray[np.int16]
    triangles: NDArray[np.uint16]
    scales: NDArray[np.float32]
    vertex_counts: NDArray[np.uint16]
    triangle_counts: NDArray[np.uint16]

    @classmethod
    def packed(cls, surfaces: Sequence[tuple[Float, NDArray[np.int64]] | None]) -> Meshes:
        """From vertices relative to the centre, mm, and triangles of each; None for those without a surface."""
        vertices, triangles = [np.zeros((0, 3), np.int16)], [np.zeros((0, 3), np.uint16)]
        scales = np.ones(len(surfaces), np.float32)
        counts = np.zeros((2, len(surfaces)), np.uint16)
        for row, surface in enumerate(surfaces):
            if surface is None:
                continue
            offsets, faces = _by_first_use(*surface)
            scales[row] = max(float(np.abs(offsets).max()), 1e-12) / COORDINATE_STEPS
            vertices.append(np.round(offsets / float(scales[row])).astype(np.int16))
            triangles.append(faces.astype(np.uint16))
            counts[:, row] = len(offsets), len(faces)
        return cls(np.concatenate(vertices), np.concatenate(triangles), scales, counts[0], counts[1])

    def of_row(self, row: int) -> tuple[Float, NDArray[np.uint16]]:
        """Vertices relative to the centre, mm, and triangles of one of them."""
        v, t = (int(counts[:row].sum()) for counts in (self.vertex_counts, self.triangle_counts))
        vertices = self.vertices[v : v + int(self.vertex_counts[row])]
        return np.asarray(vertices * float(self.scales[row]), dtype=float), self.triangles[
            t : t + int(self.triangle_counts[row])
        ]


def surface_record(
    labels: NDArray[np.integer], grid: Volume, grains: NDArray[np.integer], centers: Float
) -> dict[str, object]:
    """The shapes of grains for the page's JSON.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        Labels on the voxels of ``grid``, 0 for no grain.
    grid : Volume
        Voxel size and place of the labels.
    grains : (n,) int array
        Labels of the grains, in the page's order.
    centers : (n, 3) array
        Their centres in the reference, mm, x y z: what the surfaces are relative to.

    Returns
    -------
    dict
        Of kind "meshes" (`mesh_record`) or "ellipsoids" (a matrix a grain
        that takes the unit ball to it, mm).
    """
    if len(grains) > MAX_MESHES:
        return {"kind": "ellipsoids", "matrices": embed(ellipsoids(labels, grid, grains))}
    return {"kind": "meshes"} | mesh_record(grain_meshes(labels, grid, grains, centers))


def mesh_record(meshes: Meshes) -> dict[str, object]:
    """Surfaces for the page's JSON, as ``assets/viewer_shapes.js`` decodes them."""
    return {
        "vertices": embed(_differences(meshes.vertices, meshes.vertex_counts)),
        "triangles": embed(_below_highest(meshes.triangles, meshes.triangle_counts)),
        "scales": embed(meshes.scales),
        "vertex_counts": embed(meshes.vertex_counts),
        "triangle_counts": embed(meshes.triangle_counts),
    }


def triangle_budget(count: int) -> int:
    """Triangles a grain among ``count`` grains."""
    return int(np.clip(MAX_TRIANGLES // max(1, count), *GRAIN_TRIANGLES))


def grain_meshes(labels: NDArray[np.integer], grid: Volume, grains: NDArray[np.integer], centers: Float) -> Meshes:
    """Surfaces of the grains of these labels; arguments as of `surface_record`."""
    budget = triangle_budget(len(grains))
    surfaces: list[tuple[Float, NDArray[np.int64]] | None] = [None] * len(grains)
    for row, mask, first in counted(_masks(labels, grains), len(grains)):
        marched = _surface(mask, budget)
        if marched is not None and np.isfinite(centers[row]).all():
            places, faces = marched
            surfaces[row] = grid.origin + grid.voxel_size * (first + places) - centers[row], faces
    return Meshes.packed(surfaces)


def ellipsoids(labels: NDArray[np.integer], grid: Volume, grains: NDArray[np.integer]) -> NDArray[np.float32]:
    """Matrices ``(n, 3, 3)`` that take the unit ball to a grain's ellipsoid, mm; NaN without voxels."""
    matrices = np.full((len(grains), 3, 3), np.nan, np.float32)
    for row, mask, _ in counted(_masks(labels, grains), len(grains)):
        places = np.argwhere(mask)[:, ::-1].astype(float)
        covariance = np.cov(places.T, bias=True) + np.eye(3) / 12  # that of a voxel itself
        values, axes = np.linalg.eigh(np.atleast_2d(covariance))
        axes[:, 0] *= np.linalg.det(axes)  # a rotation, not a mirror image, so that triangles face outwards
        matrices[row] = axes * np.sqrt(5 * values) * grid.voxel_size
    return matrices


def _masks(
    labels: NDArray[np.integer], grains: NDArray[np.integer]
) -> Iterator[tuple[int, NDArray[np.bool_], NDArray[np.int64]]]:
    """Row, voxels in their box, and the first voxel of the box (x y z), of the grains that have voxels."""
    boxes = ndimage.find_objects(labels)
    for row, label in enumerate(grains):
        box = boxes[label - 1] if 0 < label <= len(boxes) else None
        if box is not None:
            yield row, labels[box] == label, np.array([s.start for s in box[::-1]])


def _surface(mask: NDArray[np.bool_], budget: int) -> tuple[Float, NDArray[np.int64]] | None:
    """Vertices (voxels from the mask's first one, x y z) and triangles of a mask; None if it has no surface."""
    cells = np.sqrt(MARCHED_SHARE * budget / TRIANGLES_A_CELL)
    blocks = [max(1, round(n / cells)) if n > 2 else 1 for n in mask.shape]
    share = block_means(mask, blocks)
    margin = 3
    field = ndimage.gaussian_filter(np.pad(share, margin), CELL_SIGMA, truncate=3)
    inside = min(max(1, round(float(share.sum()))), field.size - 1)
    level = float(np.partition(field.ravel(), -inside)[-inside])  # as many cells above it as the grain fills
    level = min(max(level, 1e-3), 0.999 * float(field.max()))
    points, faces, _, _ = marching_cubes(field, level, allow_degenerate=False)
    points, faces = simplified(points, faces, budget)
    if len(faces) < 4:
        return None
    places = (points[:, ::-1] - margin + 0.5) * blocks[::-1] - 0.5
    return _with_volume(places, faces.astype(np.int64), float(np.count_nonzero(mask)))


def simplified(points: Float, faces: NDArray[np.integer], budget: int) -> tuple[Float, NDArray[np.integer]]:
    """A mesh of about ``budget`` triangles, or what edge collapses leave of it."""
    if len(faces) <= budget:
        return points, faces
    with warnings.catch_warnings():  # a target that collapses cannot reach is no fault
        warnings.simplefilter("ignore")
        few: tuple[Float, NDArray[np.integer]] = fast_simplification.simplify(
            points.astype(np.float32), faces.astype(np.int32), target_count=budget
        )
    return few


def block_means(values: NDArray[np.generic], blocks: list[int]) -> NDArray[np.float32]:
    """Means over blocks of voxels; the last block of an axis is filled up with nothing."""
    padded = np.pad(values, [(0, -n % k) for n, k in zip(values.shape, blocks, strict=True)])
    sums = padded.astype(np.float32)
    for axis, k in enumerate(blocks):
        if k > 1:
            shape = (*sums.shape[:axis], sums.shape[axis] // k, k, *sums.shape[axis + 1 :])
            sums = sums.reshape(shape).mean(axis=axis + 1)
    return sums


def _with_volume(places: Float, faces: NDArray[np.int64], volume: float) -> tuple[Float, NDArray[np.int64]]:
    """The mesh scaled about its middle to a volume, facing outwards."""
    middle = places.mean(axis=0)
    signed = signed_volume(places - middle, faces)
    if signed < 0:
        faces = faces[:, ::-1]
    scale = np.clip(np.cbrt(volume / max(abs(signed), 1e-9)), 0.8, 1.25)
    return middle + scale * (places - middle), faces


def signed_volume(places: Float, faces: NDArray[np.integer]) -> float:
    """Volume within a closed mesh; negative if its triangles face inwards."""
    a, b, c = places[faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


def _by_first_use(places: Float, faces: NDArray[np.int64]) -> tuple[Float, NDArray[np.int64]]:
    """The same mesh with vertices in the order in which triangles name them, without those that none names."""
    used, first, inverse = np.unique(faces.ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(used), np.int64)
    rank[order] = np.arange(len(used))
    return places[used[order]], rank[inverse].reshape(-1, 3)


def _differences(vertices: NDArray[np.int16], counts: NDArray[np.uint16]) -> NDArray[np.int16]:
    """Each vertex less the one before it; the first of each grain as it is.  Small numbers compress well."""
    steps = np.diff(vertices, axis=0, prepend=np.zeros((1, 3), np.int16))
    starts = _starts(counts)
    steps[starts] = vertices[starts]
    return steps


def _below_highest(triangles: NDArray[np.uint16], counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Corners as (lowest number not yet used) − (vertex): 0 for a new vertex, else small, which compresses well."""
    corners = triangles.astype(np.int64).ravel()
    owner = np.repeat(np.arange(len(counts)), 3 * counts.astype(np.int64))
    base = owner * (1 << 17)  # grains follow one another, so that a running maximum starts anew with each
    highest = np.maximum.accumulate(corners + 1 + base)
    before = np.concatenate([[0], highest[:-1]])
    return (np.maximum(before - base, 0) - corners).astype(np.uint16)


def _starts(counts: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Row of the first vertex of each grain that has some."""
    ends = np.cumsum(counts.astype(np.int64))
    return (ends - counts)[counts > 0]
