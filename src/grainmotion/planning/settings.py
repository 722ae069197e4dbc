"""Settings of `plan`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from grainmotion._validation import validated

Count = Annotated[int, Field(ge=2, le=100)]


@validated
class PlanSettings:
    """What `grainmotion plan` assumes, and what it chooses from.

    Examples
    --------
    >>> gm.PlanSettings(photons=1e4, views=(2, 4)).views
    (2, 4)
    """

    photons: Annotated[
        float, Field(gt=0, allow_inf_nan=False, description="photons a pixel detects without the sample, a radiograph")
    ] = 20_000.0
    views: Annotated[tuple[Count, ...], Field(min_length=1, description="numbers of views to plan for")] = (2, 3, 4, 6)
    step_deg: Annotated[float, Field(ge=0.5, le=90, description="between neighbouring candidate angles, degrees")] = 5.0
    span_deg: Annotated[
        float | None,
        Field(gt=0, le=360, description="candidates lie from 0 up to here; by default 180 (parallel) or 360 (cone)"),
    ] = None
    spread: Annotated[
        float,
        Field(
            ge=0, le=1, description="no two views of a set nearer, as lines, than this share of the even step, 180°/k"
        ),
    ] = 0.6
    gain: Annotated[bool, Field(description="a global gain and offset are unknown, as in tracking")] = True
    model_error: Annotated[
        float, Field(ge=0, le=10, description="sd of a simulated pixel by the voxels' blur, in voxels of grain crossed")
    ] = 0.4
