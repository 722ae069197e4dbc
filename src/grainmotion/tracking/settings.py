"""How to track."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from grainmotion.project import Projector
from grainmotion.tracking.residual import Derivatives


@dataclass(frozen=True)
class TrackSettings:
    """How to track."""

    projector: Annotated[
        Projector, Field(description="operator; in an experiment file the reconstruction's own unless given")
    ] = "trilinear"
    derivatives: Annotated[Derivatives, Field(description="exact ones, or finite differences as in the paper")] = (
        "analytic"
    )
    filters: Annotated[
        tuple[float, ...],
        Field(
            min_length=1,
            description="Gaussian widths of the free stages in turn, pixels, for grains 45 pixels across",
        ),
    ] = (6.0, 2.0, 0.7)
    field_filter: Annotated[float, Field(ge=0, description="the same for the stages of one body and smooth field")] = (
        12.0
    )
    fields: Annotated[
        bool, Field(description="begin with one body and a smooth field; off: all grains free at once")
    ] = True
    search: Annotated[
        bool, Field(description="search widely for grains that fit badly, leave out grains that are not there")
    ] = True
    gain: Annotated[bool, Field(description="eliminate a global gain and offset (a, b of Eq. 22)")] = True
    iterations: Annotated[int, Field(ge=1, description="most iterations a stage")] = 30
    tolerance: Annotated[
        float, Field(gt=0, description="a stage ends once no grain's surface moves further, voxels")
    ] = 2e-3
    max_sd_voxel: Annotated[
        float, Field(gt=0, description="a grain is poorly determined above this sd of u, voxels")
    ] = 0.5
    max_sd_deg: Annotated[
        float, Field(gt=0, description="a grain is poorly determined above this sd of ω, degrees")
    ] = 5.0


PAPER = TrackSettings(
    projector="exact",
    derivatives="differences",
    filters=(0.0,),
    fields=False,
    search=False,
    gain=False,
    iterations=200,
)
"""The variant of Khalili et al. (2017): Siddon's path, finite differences, no filter, no stages."""
