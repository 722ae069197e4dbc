"""Settings of the mechanics that a run writes."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from grainmotion._validation import validated
from grainmotion.mechanics.contacts import DEFAULT_GAP_TOLERANCE
from grainmotion.mechanics.strains import DEFAULT_REACH, Estimator
from grainmotion.mechanics.void_ratio import Cells


@validated
class MechanicsSettings:
    """How `export mechanics` estimates strains, contacts and void ratios; see docs/mechanics.md."""

    estimator: Annotated[
        Estimator, Field(description='strain from "cells" (tetrahedra between centres) or "neighbours" (local fits)')
    ] = "cells"
    reach: Annotated[
        float, Field(gt=1, le=20, description='radius of "neighbours", in median distances of neighbouring centres')
    ] = DEFAULT_REACH
    tolerance: Annotated[float, Field(gt=0, le=5, description="gap below which two grains are in contact, voxels")] = (
        DEFAULT_GAP_TOLERANCE
    )
    cells: Annotated[
        Cells, Field(description='void ratio by "set" (nearest surface) or "radical" (balls of the same volume) cells')
    ] = "set"
