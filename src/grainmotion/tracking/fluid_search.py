"""Trial liquids: how well each level and attenuation explains the radiographs, with the grains at a pose."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from grainmotion._typing import Float, Image, Projector
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.objective.data_term import Target
from grainmotion.projection.displaced_fluid import Submersion
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.projection.volumes import project


@dataclass(frozen=True)
class FluidValues:
    """Attenuation (1/mm), height of the surface (mm, within the space) and κ of a liquid."""

    attenuation: float
    surface: float
    displaced: float = 1.0


@dataclass
class LevelSearch:
    """Residuals of trial liquids beside grains at a pose, under one filter; ``own`` are line integrals of the rest.

    ``stretches (n, 3, 3)`` are those of strained grains.
    """

    submersion: Submersion
    target: Target
    own: Image
    pose: Pose
    stretches: Float | None = None
    liquids: dict[float, tuple[Image, Image]] = field(default_factory=dict)

    def images(self, surface: float, displaced: float) -> tuple[Image, Image]:
        """Line integrals without the later liquid, and those of a liquid of unit attenuation beside them."""
        if surface not in self.liquids:
            liquid = self.submersion.reference.changed(1.0, surface)
            unit = project(liquid.volume, self.target.scan.geometry, projector=self.target.projector)
            occupied = self.submersion.wet_occupancies(liquid, self._deformed)
            self.liquids[surface] = unit, self._of_grains(occupied)
        unit, wet = self.liquids[surface]
        return self.own + displaced * self.were_wet, unit - displaced * wet

    @cached_property
    def were_wet(self) -> Image:
        """Line integrals of the reference's liquid in the grains' own places, carried to the pose."""
        reference = self.submersion.reference
        empty = reference.changed(reference.attenuation, reference.bottom)
        return self._of_grains(self.submersion.changes(empty, self._deformed))

    @property
    def _deformed(self) -> Pose:
        return deformed(self.pose, self.stretches)

    def _of_grains(self, arrays: list[Image]) -> Image:
        geometry, projector = self.target.scan.geometry, self.target.projector
        return projected_values(self.submersion.grains, arrays, self.pose, geometry, projector, self.stretches)

    def best_attenuation(self, surface: float, displaced: float) -> tuple[FluidValues, float]:
        """The attenuation that fits best with a surface and κ, and the cost."""
        fixed, unit = self.images(surface, displaced)
        gap, column = self._without_offset(fixed), self._centered(self.target.filtered(unit))
        norm = float(np.vdot(column, column))
        value = max(float(np.vdot(column, gap)) / norm, 0.0) if norm > 0 else 0.0
        return FluidValues(value, surface, displaced), 0.5 * float(np.sum((gap - value * column) ** 2))

    def cost(self, values: FluidValues) -> float:
        """The cost of a given liquid."""
        fixed, unit = self.images(values.surface, values.displaced)
        gap = self._without_offset(fixed + values.attenuation * unit)
        return 0.5 * float(np.sum(gap**2))

    def _without_offset(self, path: Image) -> Float:
        return self._centered(self.target.measured - self.target.filtered(path))

    def _centered(self, stack: Image) -> Float:
        """Images without the offset of each view, if the response has any."""
        images: Float = stack.astype(np.float64)
        for trend in self.target.trends.stacks[:1]:
            trend = trend.astype(float)
            shares = np.einsum("vrc,vrc->v", images, trend) / np.maximum(np.einsum("vrc,vrc->v", trend, trend), 1e-30)
            images = images - shares[:, None, None] * trend
        return images


def deformed(pose: Pose, stretches: Float | None) -> Pose:
    """The pose with deformation gradients Ω U of strained grains in place of their rotations Ω."""
    return pose if stretches is None else pose.moved(pose.translations, pose.matrices @ stretches)


def projected_values(
    grains: GrainSet,
    arrays: list[Image],
    pose: Pose,
    geometry: Geometry,
    projector: Projector,
    stretches: Float | None = None,
) -> Image:
    """Line integrals of other values of the grains' voxels at a pose; ``stretches (n, 3, 3)`` if they are strained."""
    rows = [k for k, array in enumerate(arrays) if array.any()]
    if not rows:
        return np.zeros((len(geometry), *geometry.shape), grains.precision)
    chosen = ((grains.grains[k], arrays[k]) for k in rows)
    kept = tuple(replace(grain, volume=replace(grain.coarse_volume, array=array), fine=None) for grain, array in chosen)
    packed, at = GrainArrays.of(GrainSet(kept)), Pose(pose.translations[rows], pose.matrices[rows])
    if stretches is not None:
        packed = packed.stretched(stretches[rows])
    patches = footprint_patches(packed, at, geometry)
    return assemble(project_patches(packed, at, geometry, patches, projector), patches, geometry)
