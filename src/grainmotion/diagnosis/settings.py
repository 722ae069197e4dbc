"""Settings of the checks of the input."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from grainmotion._validation import validated


@validated
class CheckSettings:
    """How the input is judged before hours of work.

    Examples
    --------
    >>> gm.CheckSettings(force=True).force
    True
    """

    warn: Annotated[
        float, Field(gt=0, description="residual of half of the views against the other half from which to warn")
    ] = 0.1
    stop: Annotated[float, Field(gt=0, description="the same, from which to stop")] = 0.2
    force: Annotated[bool, Field(description="go on where a check would stop the work (as --force)")] = False
    try_fixes: Annotated[
        bool, Field(description="apply what a check found to be clearly better, and say so (as --try-fixes)")
    ] = False
