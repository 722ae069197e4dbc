"""Status of a grain's fit, and its colour in the report, in figures and in notebooks."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Status(StrEnum):
    """Outcome of the fit of a grain; `Motions.reasons` gives cause and remedy.

    Examples
    --------
    >>> motions.statuses == gm.Status.CONVERGED
    array([ True,  True,  True,  True])
    """

    CONVERGED = "converged"
    NOT_CONVERGED = "not-converged"
    POORLY_DETERMINED = "poorly-determined"
    LEFT_FIELD = "left-field"
    NOT_FITTED = "not-fitted"
    AMBIGUOUS = "ambiguous"
    ABSENT = "absent"
    CUT = "cut"
    BROKEN = "broken"
    DEFORMED = "deformed"


STATUS_COLOURS = {
    Status.CONVERGED.value: "#3a9a8a",
    Status.POORLY_DETERMINED.value: "#d9b23c",
    Status.AMBIGUOUS.value: "#6fb4e8",
    Status.NOT_CONVERGED.value: "#c8425a",
    Status.LEFT_FIELD.value: "#6a63c9",
    Status.NOT_FITTED.value: "#b4bac2",
    Status.ABSENT.value: "#b05cab",
    Status.CUT.value: "#8f8f35",
    Status.BROKEN.value: "#8e2f62",
    Status.DEFORMED.value: "#e0876a",
}
"""After P. Tol's muted scheme, which colour-blind readers tell apart; a little lighter for dark pages."""


def status_counts(statuses: NDArray[np.str_]) -> dict[str, int]:
    """Number of grains of each status that occurs, in the order of `Status`."""
    counts = Counter(statuses.tolist())
    return {status.value: counts[status.value] for status in Status if counts[status.value]}
