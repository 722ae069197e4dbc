"""Settings of segmentation."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from grainmotion._validation import validated

Background = Literal["auto", "ignore", "fixed", "moving"]


@validated
class SegmentSettings:
    """How to segment a volume and extract its grains."""

    threshold: Annotated[
        float | None, Field(description="attenuation from which a voxel is grain, 1/mm; Otsu's unless given")
    ] = None
    depth: Annotated[
        float, Field(ge=0, description="least height of a distance peak over its saddle (H-minima), voxels")
    ] = 0.5
    oneness: Annotated[
        float, Field(gt=0, description="two basins are one grain from this stiffness of their neck; lower merges more")
    ] = 0.7
    min_volume: Annotated[
        int | None, Field(gt=0, description="smallest grain, voxels; 2 % of the median grain unless given")
    ] = None
    reach: Annotated[
        float, Field(ge=0, description="unlabelled attenuation up to this distance from a grain belongs to it, voxels")
    ] = 3.0
    background: Annotated[
        Background,
        Field(
            description='attenuation further away: "ignore" it, keep it "fixed" in all states, or "moving" as one body '
            "(fixed in a state whose radiographs do not show that it moved); "
            '"auto" is moving if it holds more than 2 % of all attenuation, else ignored'
        ),
    ] = "auto"
    finer: Annotated[
        int, Field(ge=1, le=4, description="upsampling, by splines, of the voxels of the last stages of tracking")
    ] = 2
