"""Likeness of a state's radiographs to coarse radiographs of the reference, moved as one body.

Both are binned until the panel has about `LIKENESS_COLUMNS` columns, and filtered so that grains count rather than the
outline of the sample.  The likeness of two radiographs is their normalised correlation, the largest over shifts of
one on the other: 1 if they are equal but for a factor.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import fft, ndimage
from skimage.measure import block_reduce

from grainmotion._typing import Float, Image
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_scan, binning_factor
from grainmotion.projection.volumes import project

LIKENESS_COLUMNS = 32
"""Columns of the coarse radiographs, unless grains are small."""
MIN_GRAIN_PIXELS, MAX_LIKENESS_COLUMNS = 4.0, 96
"""Diameter of the median grain on the coarse panel, which takes more columns for it, up to so many."""
MAX_SHIFT = 0.33
"""Largest shift of a radiograph that is tried, as a share of the panel's rows or columns."""
FINE_BLUR, BROAD_BLUR = 1.0, 0.35
"""Standard deviations of the blur of the radiographs, coarse pixels, and of the one subtracted, grain diameters."""
CONTRAST_FLOOR = 0.5
"""Power added to that nearby when contrast is made even, over the mean power: pistons must not outweigh grains."""
LEAST_ENERGY = 0.25
"""Power of a part of a simulated radiograph, over the largest of a part of its size, below which it is not divided."""


@dataclass(frozen=True, eq=False)
class Fit:
    """How well all views fit the reference moved by one translation."""

    each: Float  # likeness of each view

    @property
    def mean(self) -> float:
        """Mean likeness of the views."""
        return float(self.each.mean())


@dataclass(frozen=True, eq=False)
class Likeness:
    """Coarse radiographs of a state beside the coarse reference, which is projected once for each view asked for."""

    volume: Volume
    geometry: Geometry  # of the coarse radiographs
    plain: Image  # coarse radiographs (views, rows, columns)
    measured: Image  # the same, filtered, of norm 1
    blurs: tuple[float, float]
    _simulated: dict[bytes, tuple[Image, Float]] = field(default_factory=dict)

    @classmethod
    def of(cls, grains: GrainSet, pose: Pose, scan: Scan) -> Likeness:
        """The radiographs of a state, and the grains at ``pose``."""
        center = (grains.centers + pose.translations).mean(axis=0)
        diameter = _diameter(grains)
        pixel = scan.geometry.pixel_at(center)
        rows, columns = scan.geometry.shape
        needed = columns * pixel * MIN_GRAIN_PIXELS / diameter
        factor = binning_factor((rows, columns), int(np.clip(needed, LIKENESS_COLUMNS, MAX_LIKENESS_COLUMNS)))
        coarse = binned_scan(scan, factor, np.arange(len(scan)))
        pixel *= factor
        volume = coarse_volume(grains, pose, max(pixel, grains.voxel_size))
        blurs = FINE_BLUR, max(2 * FINE_BLUR, BROAD_BLUR * diameter / pixel)
        images = coarse.line_integrals.astype(np.float32)
        measured = filtered(images, blurs)
        measured /= np.maximum(np.linalg.norm(measured, axis=(1, 2), keepdims=True), 1e-12)
        return cls(volume, coarse.geometry, images, measured, blurs)

    def select(self, views: list[int]) -> Likeness:
        """Some of the views."""
        return replace(self, geometry=self.geometry[views], plain=self.plain[views], measured=self.measured[views])

    @property
    def window(self) -> tuple[int, int]:
        """Rows and columns of the simulated radiographs: the panel and the largest shift on each side."""
        rows, columns = self.geometry.shape
        return rows + 2 * round(MAX_SHIFT * rows), columns + 2 * round(MAX_SHIFT * columns)

    def fits_window(self, image_shape: tuple[int, ...]) -> bool:
        """Whether radiographs of another shape can be compared."""
        return all(n <= m for n, m in zip(image_shape[-2:], self.window, strict=True))

    def fit(self, images: Image, views: Geometry) -> Fit:
        """Filtered radiographs against views of the reference, at the translation of best mean likeness."""
        maps = ndimage.maximum_filter(self.maps(images, views), (1, 3, 3))
        if len(maps) == 1:
            return Fit(maps.max(axis=(1, 2)))
        centre = np.array(self.volume.center)
        pixels = views.project_points(np.vstack([centre, centre + self.volume.voxel_size * np.eye(3)]))
        derivatives = np.nan_to_num(pixels[:, 1:] - pixels[:, :1]).transpose(0, 2, 1)
        half = (np.array(maps.shape[1:]) - 1) // 2
        steps = np.arange(-half.max() - half.max() % 2, half.max() + 1, 2)  # the maximum filter covers those between
        translations = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        at = np.rint(np.einsum("vij,tj->tvi", derivatives, translations)).astype(np.int64) + half
        at = at[((at >= 0) & (at <= 2 * half)).all(axis=(1, 2))]
        values = maps[np.arange(len(maps)), at[..., 0], at[..., 1]]
        return Fit(values[values.mean(axis=1).argmax()].astype(float))

    def best(self, images: Image, views: Geometry) -> Float:
        """Likeness of each radiograph to its view, each with a shift of its own."""
        return np.asarray(self.maps(images, views).max(axis=(1, 2)), dtype=float)

    def maps(self, images: Image, views: Geometry) -> Image:
        """Likeness at all shifts ``(views, rows, columns)``; the middle is no shift, the first row the lowest place."""
        transforms, sums = zip(*self._simulate(views), strict=True)
        h, w = images.shape[1:]
        measured = np.conj(fft.rfft2(images, self._lengths))
        product = fft.irfft2(np.stack(transforms) * measured, self._lengths)
        # first[k]: where the image lies on the window at the first shift; a half pixel is the maximum filter's
        (r0, r1), (c0, c1) = self._shifts(h, 0), self._shifts(w, 1)
        s = np.stack(sums)
        power = s[:, r0 + h : r1 + h, c0 + w : c1 + w] - s[:, r0:r1, c0 + w : c1 + w]
        power += s[:, r0:r1, c0:c1] - s[:, r0 + h : r1 + h, c0:c1]
        power = np.maximum(power, np.maximum(LEAST_ENERGY * power.max(axis=(1, 2), keepdims=True), 1e-20))
        return np.asarray(product[:, r0:r1, c0:c1] / np.sqrt(power), np.float32)[:, ::-1, ::-1]

    def _shifts(self, size: int, axis: int) -> tuple[int, int]:
        """First place of an image of this size on the window, and the one after the last: an odd number of places."""
        place, spare = self._margins[axis], self.window[axis] - size
        if size != self.geometry.shape[axis]:
            place = spare // 2
        reach = min(place, spare - place)
        return place - reach, place + reach + 1

    @property
    def _margins(self) -> tuple[int, int]:
        rows, columns = self.geometry.shape
        return (self.window[0] - rows) // 2, (self.window[1] - columns) // 2

    @property
    def _lengths(self) -> tuple[int, int]:
        rows, columns = (int(fft.next_fast_len(n, real=True)) for n in self.window)
        return rows, columns

    def _simulate(self, views: Geometry) -> list[tuple[Image, Float]]:
        """Transform of each simulated radiograph, and sums of its squares from the first pixel on."""
        keys = [np.round(vector, 6).tobytes() for vector in views.vectors]
        new = sorted({key: i for i, key in enumerate(keys) if key not in self._simulated}.values())
        if new:
            down, right = self._margins
            images = project(self.volume, views[new].window((-down, -right), self.window))
            images = filtered(images, self.blurs)
            squares = np.pad((images.astype(float) ** 2).cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))
            transforms = fft.rfft2(images, self._lengths)
            self._simulated.update({keys[i]: pair for i, *pair in zip(new, transforms, squares, strict=True)})
        return [self._simulated[key] for key in keys]


def filtered(images: Image, blurs: tuple[float, float]) -> Image:
    """Differences of two blurs of each radiograph, over their size nearby: structure of the size of grains."""
    fine, broad = ((0, b, b) for b in blurs)
    out = ndimage.gaussian_filter(images, fine, mode="nearest") - ndimage.gaussian_filter(images, broad, mode="nearest")
    power = ndimage.gaussian_filter(out**2, tuple(2 * b for b in broad), mode="nearest")
    return np.asarray(out / np.sqrt(power + CONTRAST_FLOOR * power.mean(axis=(1, 2), keepdims=True) + 1e-20))


def coarse_volume(grains: GrainSet, pose: Pose, voxel_size: float) -> Volume:
    """The grains at ``pose``, and the background where it was, on voxels of ``voxel_size``."""
    block = max(1, round(voxel_size / grains.voxel_size))
    places, masses = [], []
    for grain, u, matrix in zip(grains.grains, pose.translations, pose.matrices, strict=True):
        points, mass = _blocks(grain.coarse_volume, block)
        places.append((points - grain.center) @ matrix.T + grain.center + u)
        masses.append(mass)
    if grains.background is not None:
        points, mass = _blocks(grains.background, block)
        places.append(points)
        masses.append(mass)
    x, mass = np.concatenate(places), np.concatenate(masses)
    low = x.min(axis=0) - 1.5 * voxel_size
    shape = np.ceil((x.max(axis=0) - low) / voxel_size).astype(int) + 2
    corner = np.floor((x - low) / voxel_size).astype(int)
    rest = (x - low) / voxel_size - corner
    total = np.zeros(int(np.prod(shape)))
    for offset in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(offset, rest, 1 - rest), axis=1)
        i, j, k = (corner + offset).T
        total += np.bincount((k * shape[1] + j) * shape[0] + i, mass * weight, minlength=len(total))
    array = (total / voxel_size**3).reshape(shape[::-1]).astype(np.float32)
    cx, cy, cz = low + (shape - 1) / 2 * voxel_size
    return Volume(array, voxel_size, (float(cx), float(cy), float(cz)))


def _blocks(volume: Volume, block: int) -> tuple[Float, Float]:
    """Centres (x y z, mm) of blocks of voxels that hold attenuation, and attenuation times volume of each."""
    sums = block_reduce(volume.array, block, np.sum) if block > 1 else volume.array
    where = np.argwhere(sums > 0)
    middle = where * block + (block - 1) / 2
    return volume.origin + middle[:, ::-1] * volume.voxel_size, sums[tuple(where.T)].astype(
        float
    ) * volume.voxel_size**3


def _diameter(grains: GrainSet) -> float:
    """Median diameter of the grains, mm: of the ball of as many voxels above half of the largest attenuation."""
    arrays = (grain.volume.array for grain in grains.grains)
    counts = [int((array > 0.5 * array.max()).sum()) for array in arrays]
    return float((6 / np.pi * np.median(counts)) ** (1 / 3)) * grains.voxel_size
