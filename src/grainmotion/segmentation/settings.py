"""Settings of segmentation."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from grainmotion._validation import validated
from grainmotion.errors import InputError
from grainmotion.model.scene import Freedom

Background = Literal["auto", "ignore", "fixed", "moving"]
Place = Literal["above", "below", "around", "beside"]
FluidSetting = Literal["auto", "none"] | Annotated[float, Field(gt=0)]


@validated
class BodySettings:
    """A body beside the grains, such as a piston: which it is, its name and how it may move."""

    name: Annotated[str, Field(min_length=1, description="its name in results")]
    label: Annotated[int | None, Field(gt=0, description="its label in given labels, which then is no grain")] = None
    place: Annotated[Place | None, Field(description="or where it lies: above, below, around or beside all grains")] = (
        None
    )
    freedom: Annotated[
        str,
        Field(
            description='how it may move: "fixed", "free", some of "x y z wx wy wz" (along and about axes), or '
            '"along a b c"'
        ),
    ] = "free"

    def __post_init__(self) -> None:
        Freedom.of(self.freedom)
        if (self.label is None) == (self.place is None):
            raise InputError(f"segment.bodies {self.name!r}", "needs a label or a place", "give one of the two")


PhaseKind = Literal["air", "liquid", "grains", "body"]


@validated
class PhaseSettings:
    """What is known of a phase: what it is, and its attenuation or the range of it."""

    kind: Annotated[
        PhaseKind,
        Field(description='"air", "liquid", "grains", or "body": a piston, a wall or a wire, without a label'),
    ] = "grains"
    attenuation: Annotated[float | None, Field(ge=0, description="mean attenuation, 1/mm")] = None
    range: Annotated[
        tuple[float, float] | None, Field(description="lowest and highest attenuation in place of the mean, 1/mm")
    ] = None

    @model_validator(mode="after")
    def _one_of_both(self) -> PhaseSettings:
        if (self.attenuation is None) == (self.range is None):
            raise InputError("PhaseSettings", f"'{self.kind}' needs either attenuation or range", "give one of them")
        if self.range is not None and not self.range[0] < self.range[1]:
            raise InputError("PhaseSettings.range", f"{self.range} is not rising", "give the lower end first")
        return self

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest attenuation, 1/mm; the same if the mean was given."""
        if self.range is not None:
            return self.range
        assert self.attenuation is not None
        return self.attenuation, self.attenuation


@validated
class SegmentSettings:
    """How to segment a volume and extract its grains.

    Examples
    --------
    >>> gm.SegmentSettings(threshold=0.05).threshold
    0.05
    """

    threshold: Annotated[
        float | None, Field(gt=0, description="attenuation from which a voxel is grain, 1/mm; Otsu's unless given")
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
            description='attenuation further away (pistons, a wall, fines): "ignore" it, keep it "fixed" in all '
            'states, or "moving", each connected piece as a body of its own (fixed in a state whose radiographs do not '
            'show that it moved); "auto" is moving if it holds more than 2 % of all attenuation, else ignored'
        ),
    ] = "auto"
    phases: Annotated[
        tuple[PhaseSettings, ...],
        Field(description="all phases, as tables `[[segment.phases]]`; found by themselves unless given"),
    ] = ()
    bodies: Annotated[
        tuple[BodySettings, ...],
        Field(description="what is known of bodies beside the grains, as tables `[[segment.bodies]]`"),
    ] = ()
    finer: Annotated[
        int, Field(ge=1, le=4, description="upsampling, by splines, of the voxels of the last stages of tracking")
    ] = 2
    fluid: Annotated[
        FluidSetting,
        Field(
            description='a liquid around the grains: "auto" looks for one, "none" is a dry sample, a number is its '
            "attenuation, 1/mm"
        ),
    ] = "auto"
