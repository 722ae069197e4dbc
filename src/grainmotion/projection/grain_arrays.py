"""GrainArrays: the voxels and outlines of all grains of a sample as flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from skimage.measure import block_reduce

from grainmotion._typing import Float, Image
from grainmotion.backends.base import PatchBackend
from grainmotion.backends.cpu import CPU
from grainmotion.errors import InputError
from grainmotion.kernels import grain_ray_tracing
from grainmotion.kernels.layout import PADDING, GrainTable
from grainmotion.kernels.outermost import outermost
from grainmotion.model.compact_volume import CompactVolume, CompactVoxels
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.model.task_map import each_at_hand
from grainmotion.model.volume import Volume

OUT_OF_PLANE = (2, 3, 4)
"""Components of (u, δ) that are zero in a planar sample: u_z, δ_x, δ_y."""
MAX_GRAIN_VOXELS = 2**31 - 1
"""Of one grain or background, with its padding: the largest index of the kernels."""
HULL_DIRECTIONS = 128


@dataclass(frozen=True, eq=False)
class GrainArrays:
    """A `GrainSet` as the flat arrays that kernels trace (see `kernels.layout.GrainTable`).

    ``compact`` are their voxels instead of ``images`` where finer grains are kept compactly.
    ``extents (n, 2, directions)`` are the pairs of planes between which each grain's voxels count (voxels, see
    `kernels.grain_ray_tracing`).  ``hulls (n, k, 3)`` are outermost points of each grain from its centre,
    ``radii (n,)`` the radii of balls with the grains' own moments of inertia, both in mm.  ``voxel_size`` is that of
    these images and ``unit`` that of the reference, in which tolerances are given.  ``backend`` projects the grains,
    from ``placed``, their voxels in its memory (None: the images themselves).  ``stretches (n, 3, 3)`` deform the
    voxels about the centres (see `kernels.stretched_grain_projection`); None for rigid grains, ``hulls`` are stretched.
    """

    images: Image
    starts: NDArray[np.int64]
    shapes: NDArray[np.int64]
    corners: Float
    extents: Image
    centers: Float
    hulls: Float
    radii: Float
    voxel_size: float
    unit: float
    backend: PatchBackend = CPU
    placed: object = None
    stretches: Float | None = None
    compact: CompactVoxels | None = None

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def precision(self) -> np.dtype[np.floating]:
        """The precision in which the grains are projected: that of their voxels."""
        return self.images.dtype

    def on(self, backend: PatchBackend) -> GrainArrays:
        """The same grains, to be projected by a backend if it accepts them."""
        heights, relative_size = self.centers[:, 2], self.voxel_size / self.unit
        if self.compact is not None and not backend.takes_compact_voxels:
            return self.written().on(backend)
        voxels = self.images if self.compact is None else self.compact
        accepted, placed = backend.place_voxels(voxels, self.starts, heights, relative_size)
        return replace(self, backend=accepted, placed=placed)

    def written(self) -> GrainArrays:
        """The same grains with voxels in single precision, where they are kept compactly."""
        if self.compact is None:
            return self
        images, starts = self.compact.written(np.arange(len(self.compact.volumes)))
        return replace(self, images=images, starts=starts[self.starts], compact=None, placed=None)

    def table(self, pose: Pose) -> GrainTable:
        """The grains at a pose, as kernels take them."""
        return GrainTable(
            (self.images if self.compact is None else self.compact) if self.placed is None else self.placed,
            self.starts, self.shapes, self.corners, self.extents, self.voxel_size,
            self.centers + pose.translations, np.ascontiguousarray(pose.matrices), self.stretches,
        )  # fmt: skip

    def stretched(self, stretches: Float) -> GrainArrays:
        """The grains with other ``stretches (n, 3, 3)`` U; the CPU projects them."""
        stretches = np.ascontiguousarray(stretches)
        rigid = self.hulls if self.stretches is None else self.hulls @ np.linalg.inv(self.stretches)
        hulls = rigid @ stretches  # U is symmetric
        return replace(self, hulls=hulls, stretches=stretches, backend=CPU, placed=None)

    @classmethod
    def of(cls, grains: GrainSet, fine: bool = False) -> GrainArrays:
        """Pack the grains' voxels one after the other; ``fine`` takes their finer ones if all have some."""
        fine = fine and all(g.fine is not None for g in grains.grains)
        volumes = [g.fine if fine and g.fine is not None else g.volume for g in grains.grains]
        sizes = np.array([np.prod(v.shape) for v in volumes], dtype=np.int64)
        if sizes.max() > MAX_GRAIN_VOXELS:
            raise InputError(
                "grains", f"one spans {sizes.max()} voxels, more than {MAX_GRAIN_VOXELS}", "reconstruct coarser"
            )
        corners = np.array([v.origin - g.center for v, g in zip(volumes, grains.grains, strict=True)]).reshape(-1, 3)
        h = volumes[0].voxel_size
        hulls, extents, radii = zip(
            *each_at_hand(_outline, list(zip(volumes, grains.grains, strict=True))), strict=True
        )
        compact = [v for v in volumes if isinstance(v, CompactVolume)]
        kept = len(compact) == len(volumes)
        starts = np.arange(len(grains)) if kept else np.concatenate([[0], np.cumsum(sizes)[:-1]])
        return cls(
            images=np.zeros(0, np.float32) if kept else _end_to_end([v.array for v in volumes]),
            compact=CompactVoxels(compact) if kept else None,
            starts=starts.astype(np.int64),
            shapes=np.array([v.shape for v in volumes], dtype=np.int64),
            corners=corners,
            extents=np.array(extents),
            centers=grains.centers,
            hulls=np.array(hulls),
            radii=np.array(radii),
            voxel_size=h,
            unit=grains.voxel_size,
        )

    def voxels_of(self, row: int) -> Image:
        """The voxels of one grain, flat."""
        if self.compact is not None:
            return self.compact.volumes[int(self.starts[row])].array.ravel()
        return self.images[self.starts[row] : self.starts[row] + int(self.shapes[row].prod())]

    def select(self, which: Sequence[int] | NDArray[np.int64]) -> GrainArrays:
        """Some of the grains; a row may come more than once, and shares its voxels."""
        index = np.asarray(which, dtype=np.int64)
        rows = ("starts", "shapes", "corners", "extents", "centers", "hulls", "radii")
        some = replace(self, **{name: vars(self)[name][index] for name in rows})
        return some if self.stretches is None else replace(some, stretches=self.stretches[index])

    def alone(self, which: NDArray[np.int64]) -> GrainArrays:
        """Some of the grains, as `select`, with their own voxels and no others'."""
        some = self.select(which)
        rows, places = np.unique(some.starts, return_inverse=True)
        if self.compact is not None:
            return replace(
                some, compact=CompactVoxels([self.compact.volumes[k] for k in rows]), starts=places, placed=None
            )
        first = np.unique(some.starts, return_index=True)[1]
        sizes = some.shapes[first].prod(axis=1)
        images = np.concatenate([self.images[a : a + n] for a, n in zip(rows, sizes, strict=True)])
        return replace(some, images=images, starts=(np.cumsum(sizes) - sizes)[places], placed=None)

    def coarsened(self, factor: int) -> GrainArrays:
        """The grains on voxels ``factor`` times as large, each the mean of those that it holds."""
        if factor == 1:
            return self
        images, shapes = [], []
        for row, shape in enumerate(counted(self.shapes)):
            inner = self.voxels_of(row).reshape(shape)
            images.append(np.pad(block_reduce(inner, factor, np.mean), PADDING))
            shapes.append(images[-1].shape)
        sizes = np.array([i.size for i in images])
        # the first coarse voxel's centre lies (factor − 1)/2 voxels inside; then come the empty layers
        shift = self.voxel_size * ((factor - 1) / 2 - PADDING * factor)
        return GrainArrays(
            np.concatenate([i.ravel() for i in images]), np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
            np.array(shapes, dtype=np.int64), self.corners + shift, np.array([_extents(_line_ends(i)) for i in images]),
            self.centers, self.hulls, self.radii, self.voxel_size * factor, self.unit, stretches=self.stretches,
        )  # fmt: skip

    @property
    def voxel_reach(self) -> float:
        """Edge of the largest voxel once it is stretched, mm."""
        largest = 1.0 if self.stretches is None else float(np.linalg.norm(self.stretches, 2, axis=(1, 2)).max())
        return self.voxel_size * max(largest, 1.0)


def planar(grains: GrainArrays, geometry: Geometry) -> bool:
    """Whether all is one slice: grains one voxel thick at one height, projected by one row of rays in their plane."""
    if geometry.shape[0] != 1 or np.any(grains.shapes[:, 0] != 1 + 2 * PADDING):
        return False
    height = grains.centers[0, 2]
    rays = geometry.source[:, 2] - (height if geometry.beam == "cone" else 0.0)
    off = np.concatenate([grains.centers[:, 2] - height, geometry.detector[:, 2] - height, rays, geometry.u[:, 2]])
    return bool(np.abs(off).max() <= 1e-6 * grains.voxel_size)


def _end_to_end(arrays: list[Image]) -> Image:
    """All arrays one after the other: the array of which they are parts, if they lie so in it, else a copy."""
    base = arrays[0].base
    ends = np.cumsum([a.nbytes for a in arrays])
    first = arrays[0].ctypes.data
    follow = all(a.ctypes.data == first + end - a.nbytes for a, end in zip(arrays, ends, strict=True))
    if isinstance(base, np.ndarray) and base.ndim == 1 and follow and all(a.base is base for a in arrays):
        start = (first - base.ctypes.data) // base.itemsize
        return base[start : start + ends[-1] // base.itemsize]
    return np.concatenate([a.ravel() for a in arrays])


def _outline(volume_and_grain: tuple[Volume | CompactVolume, Grain]) -> tuple[Float, Image, float]:
    """Hull, extents and radius of a grain, from its finer or its own voxels."""
    volume, grain = volume_and_grain
    if isinstance(volume, CompactVolume):
        points, extents = _compact_outline(volume)
    else:
        ends = _line_ends(volume.array)
        points, extents = _extreme_points(ends, volume.shape), _extents(ends)
    hull = points * volume.voxel_size + (volume.origin - grain.center)
    return hull, extents, _radius(grain)


def _radius(grain: Grain) -> float:
    """Radius of the ball whose attenuation spreads as the grain's does: r² = 5/3 of the mean square distance.

    At least that of the ball inscribed in a voxel, which a grain of one voxel has.
    """
    array = np.abs(grain.volume.array)
    if not array.any():
        return grain.volume.voxel_size
    axes = [
        grain.volume.origin[k] + grain.volume.voxel_size * np.arange(array.shape[2 - k]) - grain.center[k]
        for k in range(3)
    ]
    marginals = [array.sum(axis=tuple({0, 1, 2} - {2 - k}), dtype=float) for k in range(3)]
    radius = float(np.sqrt(5 / 3 * sum((m @ a**2) / m.sum() for m, a in zip(marginals, axes, strict=True))))
    return max(radius, grain.volume.voxel_size / 2)


def _line_ends(array: Image) -> Float:
    """Voxels (x y z indices) at either end of each line of voxels along x with a part of the grain, ``(k, 3)``."""
    filled = array != 0
    z, y = np.nonzero(filled.any(axis=2))
    lines = filled[z, y]
    ends = np.concatenate([lines.argmax(axis=1), lines.shape[1] - 1 - lines[:, ::-1].argmax(axis=1)])
    return np.column_stack([ends, np.tile(y, 2), np.tile(z, 2)]).astype(float)


def _compact_outline(volume: CompactVolume) -> tuple[Float, Image]:
    """`_extreme_points` and `_extents` from where each line begins and ends."""
    normals = grain_ray_tracing.DIRECTIONS.astype(float)
    directions = np.concatenate([ball_directions(), normals])
    least, furthest, points = np.empty(len(directions)), np.empty(len(directions)), np.empty((len(directions), 3))
    if not outermost(volume.firsts, volume.ends, volume.shape[1], directions, least, furthest, points):
        nothing = np.zeros((0, 3))
        return _extreme_points(nothing, volume.shape), _extents(nothing)
    reach, own = grain_ray_tracing.REACH, slice(len(directions) - len(normals), None)
    return points[:HULL_DIRECTIONS], np.array([least[own] - reach, furthest[own] + reach], np.float32)


def _extents(points: Float) -> Image:
    """The planes along `grain_ray_tracing.DIRECTIONS` between which a grain's voxels count, ``(2, directions)``."""
    if len(points) == 0:
        return np.zeros((2, len(grain_ray_tracing.DIRECTIONS)), np.float32)
    places = points @ grain_ray_tracing.DIRECTIONS.T.astype(float)
    return np.array(
        [places.min(axis=0) - grain_ray_tracing.REACH, places.max(axis=0) + grain_ray_tracing.REACH], np.float32
    )


def _extreme_points(points: Float, shape: tuple[int, int, int]) -> Float:
    """Voxels (x y z indices) of the grain that reach furthest in many directions: its convex hull, nearly."""
    if len(points) == 0:
        return np.full((HULL_DIRECTIONS, 3), (np.array(shape[::-1]) - 1) / 2)
    return points[np.argmax(ball_directions() @ points.T, axis=1)]


def ball_directions() -> Float:
    """Unit vectors in all directions, ``(k, 3)``."""
    k = np.arange(HULL_DIRECTIONS) + 0.5
    height, angle = 1 - 2 * k / HULL_DIRECTIONS, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])
