"""Likeness of a volume and radiographs on coarse pixels, whatever the sample was shifted by.

Projections of the volume and radiographs are blurred alike, so that motions of single grains matter little.  One shift
of the whole volume, mm, is found from the cross-correlations of all views together, and one factor of the attenuation
by least squares.  What remains, the residual relative to the radiographs, judges a hypothesis about the volume.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from grainmotion._typing import Float
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_scan, binning_factor
from grainmotion.projection.volumes import project

COMPARED_COLUMNS = 48
"""Columns of the coarse panel."""
COARSE_SIGMA = 1.5
"""Width of the Gaussian filter of coarse radiographs, coarse pixels."""
MAX_COARSE_SHIFT = 10
"""Largest shift of the volume along each axis, coarse pixels."""
MAX_VIEWS_COMPARED = 8
"""Views of a full scan with which a volume is compared."""
AIR_QUANTILE = 0.3
"""Quantile of the pixels beside the volume that is air."""
MIN_SHARE_BESIDE = 0.03
"""Share of a view's pixels beside the volume, from which its air is taken from them."""
VOXELS_OF_BOX = 128
"""Voxels along the shortest edge of a volume, from which rays that pass it by are looked for with larger ones: they are
still finer than the coarse panel."""
SHIFT_STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
"""Steps of the search for a shift, coarse pixels."""


@dataclass(frozen=True)
class Match:
    """How well a volume explains radiographs.

    Attributes
    ----------
    residual : float
        Norm of what remains over that of the radiographs, 0 to 1.
    gain : float
        Factor of the attenuation.
    shift : (3,) array
        Of the volume, mm, x y z.
    """

    residual: float
    gain: float
    shift: Float


@dataclass(frozen=True, eq=False)
class CoarseScan:
    """Radiographs on coarse pixels, to be compared with volumes around a point of the sample."""

    scan: Scan
    center: tuple[float, float, float]

    @classmethod
    def of(cls, scan: Scan, center: tuple[float, float, float]) -> CoarseScan:
        """Coarse radiographs of a scan; no more than `MAX_VIEWS_COMPARED` views, evenly spaced."""
        views = np.unique(np.linspace(0, len(scan) - 1, min(len(scan), MAX_VIEWS_COMPARED)).round().astype(np.int64))
        if len(scan) > MAX_VIEWS_COMPARED:  # the last view of a turn may be the first one again
            views = np.arange(MAX_VIEWS_COMPARED) * len(scan) // MAX_VIEWS_COMPARED
        return cls(binned_scan(scan, binning_factor(scan.geometry.shape, COMPARED_COLUMNS), views), center)

    @cached_property
    def pixel(self) -> float:
        """Size of a coarse pixel at the sample, mm."""
        return self.scan.geometry.pixel_at(self.center)

    @cached_property
    def images(self) -> Float:
        """The blurred radiographs."""
        return _blurred(self.scan.line_integrals)

    @cached_property
    def _spectrum(self) -> NDArray[np.complexfloating]:
        return fft.rfft2(self.images, s=self._padded_shape)

    @property
    def _padded_shape(self) -> tuple[int, int]:
        rows, columns = self.scan.geometry.shape
        return 2 * rows, 2 * columns

    @cached_property
    def _derivatives(self) -> Float:
        """Derivative ``(views, 2, 3)`` of row and column to a shift, 1/mm."""
        points = np.array(self.center) + self.pixel * np.concatenate([np.zeros((1, 3)), np.eye(3)])
        pixels = self.scan.geometry.project_points(points)
        return (pixels[:, 1:] - pixels[:, :1]).transpose(0, 2, 1) / self.pixel

    def match(self, volume: Volume) -> Match:
        """Compare the radiographs with a coarse volume.

        Parameters
        ----------
        volume : Volume
            Of voxels about as large as the coarse pixels, see `coarse_volume`.

        Returns
        -------
        Match
            At the best shift.
        """
        images = _blurred(project(volume, self.scan.geometry))
        norm, measured = float(np.linalg.norm(images)), float(np.linalg.norm(self.images))
        if norm == 0 or measured == 0:
            return Match(1.0, 0.0, np.zeros(3))
        spectrum = np.conj(fft.rfft2(images, s=self._padded_shape))
        correlation = fft.irfft2(self._spectrum * spectrum, s=self._padded_shape)
        splines = np.array([ndimage.spline_filter(c, mode="grid-wrap") for c in correlation])
        shift, highest = np.zeros(3), 0.0
        for k, step in enumerate(SHIFT_STEPS):
            reach = int(MAX_COARSE_SHIFT / step) if k == 0 else 1
            axis = step * self.pixel * np.arange(-reach, reach + 1)
            shifts = shift + np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
            # a linear interpolation, which is faster, has its peaks on pixels
            sums = self._sum_at(splines, shifts, 3) if step < 1 else self._sum_at(correlation, shifts, 1)
            shift, highest = shifts[int(sums.argmax())], float(sums.max())
        cosine = highest / (norm * measured)
        return Match(float(np.sqrt(max(0.0, 1 - cosine**2))), highest / norm**2, shift)

    def _sum_at(self, correlation: Float, shifts: Float, order: Literal[1, 3]) -> Float:
        """Cross-correlation of all views at shifts ``(n, 3)`` of the volume."""
        places = np.einsum("vij,nj->vin", self._derivatives, shifts)
        total = np.zeros(len(shifts))
        for image, place in zip(correlation, places, strict=True):
            total += ndimage.map_coordinates(image, place, order=order, mode="grid-wrap", prefilter=False)
        return total

    def above_air(self, volume: Volume) -> CoarseScan:
        """The same with air at 0 in each view that sees some beside the volume: a beam that drifts gives it a level."""
        images = self.scan.line_integrals.copy()
        for image, beside in zip(images, self._beside(volume), strict=True):
            if beside.mean() >= MIN_SHARE_BESIDE:
                image -= np.quantile(image[beside], AIR_QUANTILE)
        return CoarseScan(replace(self.scan, line_integrals=images), self.center)

    def share_outside(self, volume: Volume) -> float:
        """Share of the radiographs' line integrals on pixels whose rays pass the volume by."""
        images = np.maximum(self.scan.line_integrals, 0)
        total = float(images.sum(dtype=float))
        return float(images[self._beside(volume)].sum(dtype=float)) / total if total > 0 else 0.0

    def _beside(self, volume: Volume) -> NDArray[np.bool_]:
        """Pixels whose rays pass the volume by."""
        factor = max(1, min(volume.shape) // VOXELS_OF_BOX)
        shape = tuple(-(-n // factor) for n in volume.shape)
        ones = Volume(np.ones(shape, np.float32), factor * volume.voxel_size, volume.center)
        return project(ones, self.scan.geometry) < volume.voxel_size


def coarse_volume(volume: Volume, pixel: float) -> Volume:
    """A volume on voxels of about the size of a coarse pixel, around the same centre."""
    factor = max(1, min(round(pixel / volume.voxel_size), min(volume.shape) // 2))
    if factor == 1:
        return volume
    padding = [(-n % factor // 2, -n % factor - -n % factor // 2) for n in volume.shape]
    nz, ny, nx = ((n + sum(more)) // factor for n, more in zip(volume.shape, padding, strict=True))
    array = np.empty((nz, ny, nx), volume.array.dtype)
    for k in range(nz):  # layer by layer: no padded copy of the whole volume
        first = k * factor - padding[0][0]
        layer = volume.array[max(first, 0) : first + factor]
        ends = (max(-first, 0), max(first + factor - volume.shape[0], 0))
        blocks = np.pad(layer, [ends, *padding[1:]]).reshape(factor, ny, factor, nx, factor)
        array[k] = blocks.mean(axis=(0, 2, 4))
    offset = np.array([(after - before) / 2 for before, after in padding[::-1]]) * volume.voxel_size
    x, y, z = np.array(volume.center) + offset
    return Volume(array, factor * volume.voxel_size, (x, y, z))


def _blurred(images: NDArray[np.floating]) -> Float:
    return ndimage.gaussian_filter(images.astype(float), (0, COARSE_SIGMA, COARSE_SIGMA), mode="constant")
