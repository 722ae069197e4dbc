"""Settings of the export of grains into DEM codes: the table ``[dem]`` of the experiment file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from grainmotion._validation import validated
from grainmotion.grain_shapes.clump import ClumpFit
from grainmotion.grain_shapes.harmonics import MAX_DEGREE

ShapeKind = Literal["stl", "level-set", "clump", "harmonics"]
LevelSetCode = Literal["yade", "ls-dem", "lammps"]


@validated
class DemSettings:
    """Which shapes of the grains are written for DEM codes, and how finely."""

    shapes: Annotated[
        tuple[ShapeKind, ...], Field(min_length=1, description='of "stl", "level-set", "clump", "harmonics"')
    ] = ("stl", "level-set", "clump", "harmonics")
    spacing: Annotated[float, Field(ge=0.25, le=8, description="of the level set's grid, voxels")] = 1.0
    codes: Annotated[
        tuple[LevelSetCode, ...],
        Field(min_length=1, description='whose level-set files: of "yade", "ls-dem", "lammps"'),
    ] = ("yade", "ls-dem")
    spheres: Annotated[int, Field(ge=1, le=2000, description="largest number of spheres of a clump")] = 20
    max_volume_error: Annotated[
        float, Field(ge=0, lt=1, description="empty share of a grain's volume at which its clump has enough spheres")
    ] = 0.0
    clump_fit: Annotated[
        ClumpFit,
        Field(
            description='"inside": spheres touch the surface from inside; "volume": all enlarged by the same length '
            "until the clump has the grain's volume"
        ),
    ] = "volume"
    degree: Annotated[int, Field(ge=1, le=MAX_DEGREE, description="largest degree of the spherical harmonics")] = 12
