"""One grain as a rigid body: its mass properties, and its shapes in its own frame.

The frame of a body has its origin at the centre of the grain's volume and its axes along the principal axes of inertia,
the smallest moment first, as level-set codes want it.  The centre of the volume is not the centre of the motions, which
is that of the attenuation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.grain_shapes.clump import Clump, clump_of
from grainmotion.grain_shapes.harmonics import Harmonics, harmonics
from grainmotion.grain_shapes.level_set import LevelSet, level_set
from grainmotion.grain_shapes.mass_properties import MassProperties, mass_properties
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.grain_shapes.surface import GrainSurface, grain_surface
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.model.grains import Grain, GrainSet


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A grain for a DEM code; shapes are None where they were not asked for or could not be made."""

    label: int
    touches_border: bool
    voxel_size: float  # mm
    reason: str = ""  # why a shape is missing
    in_sample: GrainSurface | None = None  # reference state, sample frame
    properties: MassProperties | None = None  # reference state, sample frame
    surface: Surface | None = None  # in the body's own frame, like all that follow
    level_set: LevelSet | None = None
    clump: Clump | None = None
    harmonics: Harmonics | None = None

    @property
    def axes(self) -> Float | None:
        """Rotation from the body's frame to that of the sample in the reference state ``(3, 3)``."""
        return None if self.properties is None else self.properties.principal_axes


def rigid_bodies(grains: GrainSet, settings: DemSettings) -> Iterator[RigidBody]:
    """Each grain as a rigid body, one at a time, so that no more than one is in memory."""
    return (rigid_body(grain, settings) for grain in grains.grains)


def rigid_body(grain: Grain, settings: DemSettings) -> RigidBody:
    """A grain as a rigid body with the shapes that the settings name; what fails is said in its reason."""
    bare = RigidBody(grain.label, grain.touches_border, grain.volume.voxel_size)
    try:
        in_sample = grain_surface(grain)
    except InputError as error:
        return replace(bare, reason=f"no surface: {error.fact}")
    properties = mass_properties(in_sample)
    axes = properties.principal_axes
    surface = in_sample.moved(axes.T, -axes.T @ properties.center)
    spacing, reasons = settings.spacing * grain.volume.voxel_size, []
    field = spheres = expansion = None
    if "level-set" in settings.shapes:
        try:
            field = level_set(surface, spacing)
        except InputError as error:
            reasons.append(f"no level set: {error.fact}")
    if "clump" in settings.shapes:
        try:
            same = field if settings.spacing == 1 and field is not None else level_set(surface, grain.volume.voxel_size)
            spheres = clump_of(surface, same, settings.spheres, settings.max_volume_error, settings.clump_fit)
        except InputError as error:
            reasons.append(f"no clump: {error.fact}")
    if "harmonics" in settings.shapes:
        try:
            expansion = harmonics(surface, settings.degree)
            if not expansion.star_shaped:
                reasons.append(f"no spherical harmonics: not star-shaped ({expansion.overhang:.1%} overhang)")
        except InputError as error:
            reasons.append(f"no spherical harmonics: {error.fact}")
    return replace(
        bare, reason="; ".join(reasons), in_sample=in_sample, properties=properties, surface=surface,
        level_set=field, clump=spheres, harmonics=expansion,
    )  # fmt: skip
