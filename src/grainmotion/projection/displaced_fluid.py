"""Grains in a liquid at a pose: what each adds to the image of the liquid simulated as if no grain were in it.

A grain of the reference holds its excess e = μ − φ₀ o over the liquid there.  Moved to a place where the liquid
attenuates φ, it adds

    e + κ (φ₀ − φ) o,

with o the share of a voxel that it occupies, φ₀ at the voxel's place in the reference and φ at its present one.  o
follows from the excess: 1 inside, and at the surface the excess over that inside, so that noise stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from edt import edt
from scipy import ndimage

from grainmotion._typing import Float, Image
from grainmotion.model.fluid import Fluid, FluidFit, below_level
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume

INTERIOR_DEPTH = 2.0
"""Depth below a grain's surface, taken at half of its excess, from which it fills its voxels, reference voxels."""
MAX_OCCUPANCY = 1.5
"""Largest share of a voxel: above 1 by noise, which a cut at 1 would make a loss."""
NEGLIGIBLE_CHANGE = 0.003
"""Change of the liquid in a grain's place, over the grain's own excess, below which the grain stays as it is."""


@dataclass(frozen=True, eq=False)
class Submersion:
    """Grains of a wet reference, and the liquid in which they were.

    Attributes
    ----------
    grains : GrainSet
        Each with its excess over ``scene.fluid``.
    """

    grains: GrainSet

    @property
    def reference(self) -> Fluid:
        """The liquid of the reference."""
        assert self.grains.scene.fluid is not None
        return self.grains.scene.fluid

    @cached_property
    def within(self) -> Float:
        """Share of each grain's voxels that lie in the space which the liquid can fill, ``(n,)``."""
        return np.array([_share_within(grain.coarse_volume, self.reference.space) for grain in self.grains.grains])

    @cached_property
    def occupancies(self) -> list[Image]:
        """Share of each voxel that its grain occupies, a grain's array each."""
        surface = self.reference.surface
        return [_occupancy(grain.coarse_volume, surface, 1.0) for grain in self.grains.grains]

    @cached_property
    def _fine_occupancies(self) -> dict[int, Image]:
        return {}

    def effective(self, fluid: Fluid, displaced: float, pose: Pose) -> GrainSet:
        """The grains with what each adds at a pose to the image of ``fluid``; ``displaced`` is κ."""
        if not displaced:
            return self.grains
        out = []
        for k, grain in enumerate(self.grains.grains):
            coarse = grain.coarse_volume
            change = self._change(k, coarse, fluid, pose)
            least = NEGLIGIBLE_CHANGE * float(np.abs(coarse.array).max())
            if np.abs(change).max() <= least:
                out.append(grain)
                continue
            volume = replace(coarse, array=coarse.array + displaced * change * self.occupancies[k])
            fine = grain.fine_volume
            if fine is not None:
                if k not in self._fine_occupancies:
                    scale = coarse.voxel_size / fine.voxel_size
                    self._fine_occupancies[k] = _occupancy(fine, self.reference.surface, scale)
                change = self._change(k, fine, fluid, pose) * self._fine_occupancies[k]
                fine = replace(fine, array=fine.array + displaced * change)
            out.append(replace(grain, volume=volume, fine=fine))
        return replace(self.grains, grains=tuple(out))

    def in_state(self, fit: FluidFit, pose: Pose) -> GrainSet:
        """The grains with what each adds at a pose to the image of the liquid that a state found.

        ``pose.matrices`` are deformation gradients where grains are strained.
        """
        return self.effective(self.reference.found(fit), 1.0 if np.isnan(fit.displaced) else fit.displaced, pose)

    def _change(self, k: int, volume: Volume, fluid: Fluid, pose: Pose) -> Image:
        """φ₀ − φ at each voxel of a grain, 1/mm."""
        before = self.reference.attenuation * self._wet_before(volume)
        after = fluid.attenuation * _wet(volume, self.grains.grains[k], fluid, pose, k)
        return np.asarray(self.within[k] * (before - after), volume.array.dtype)

    def _wet_before(self, volume: Volume) -> Float:
        z = volume.origin[2] + volume.voxel_size * np.arange(volume.shape[0])
        return below_level(z, self.reference.surface, volume.voxel_size)[:, None, None]

    def wet_occupancies(self, fluid: Fluid, pose: Pose, low: float = -np.inf) -> list[Image]:
        """Share of each voxel that its grain occupies below the liquid's surface and above ``low``, at a pose."""
        lower = replace(fluid, level=low) if np.isfinite(low) else None
        out = []
        for k, grain in enumerate(self.grains.grains):
            wet = _wet(grain.coarse_volume, grain, fluid, pose, k)
            if lower is not None:
                wet = wet - _wet(grain.coarse_volume, grain, lower, pose, k)
            out.append(np.asarray(self.within[k] * wet * self.occupancies[k], grain.volume.dtype))
        return out

    def changes(self, fluid: Fluid, pose: Pose) -> list[Image]:
        """(φ₀ − φ) o of each voxel of each grain at a pose, 1/mm."""
        return [
            self._change(k, grain.coarse_volume, fluid, pose) * self.occupancies[k]
            for k, grain in enumerate(self.grains.grains)
        ]


def _wet(volume: Volume, grain: Grain, fluid: Fluid, pose: Pose, k: int) -> Float:
    """Share of each of a moved grain's voxels that lies below the liquid's surface."""
    x, y, z = (
        volume.origin[axis] - grain.center[axis] + volume.voxel_size * np.arange(volume.shape[2 - axis])
        for axis in range(3)
    )
    up = pose.matrices[k][2]
    height = float(grain.center[2] + pose.translations[k][2])
    heights = height + up[2] * z[:, None, None] + up[1] * y[:, None] + up[0] * x
    return below_level(heights, fluid.surface, volume.voxel_size)


def _share_within(volume: Volume, space: Volume) -> float:
    """Share of a grain's attenuation that lies where a space is filled."""
    start = np.round((volume.origin - space.origin) / space.voxel_size).astype(int)[::-1]
    low, high = np.maximum(start, 0), np.minimum(start + volume.shape, space.shape)
    if (high <= low).any():
        return 0.0
    here = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    own = tuple(slice(a, b) for a, b in zip(low - start, high - start, strict=True))
    weight = np.abs(volume.array[own])
    return float(np.clip((weight * space.array[here]).sum() / max(float(weight.sum()), 1e-30), 0, 1))


def _occupancy(volume: Volume, surface: float, scale: float) -> Image:
    """Share of each voxel that a grain occupies; its excess may differ above and below the liquid's ``surface``.

    ``scale`` is the edge of a voxel of the reference over that of these.
    """
    array = volume.array
    smooth = ndimage.gaussian_filter(array, 0.7 * scale)
    solid = ndimage.binary_fill_holes(smooth > 0.5 * np.percentile(smooth[array != 0], 75))
    depth = edt(np.ascontiguousarray(solid, np.uint8), parallel=1)
    inner = depth > min(INTERIOR_DEPTH * scale, 0.6 * float(depth.max()))
    z = volume.origin[2] + volume.voxel_size * np.arange(volume.shape[0])
    below = np.broadcast_to((z < surface)[:, None, None], array.shape)
    inside = float(array[inner].mean())
    out = np.zeros_like(array)
    for side in (below, ~below):
        here = inner & side
        own = float(array[here].mean()) if here.sum() > 30 else inside
        out[side] = np.clip(array[side] / own, -MAX_OCCUPANCY, MAX_OCCUPANCY)
    out[inner] = 1
    return out
