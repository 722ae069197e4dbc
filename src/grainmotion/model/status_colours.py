"""A colour for each status of a grain, the same in the report, in figures and in notebooks."""

from __future__ import annotations

from grainmotion.model.motions import Status

STATUS_COLOURS = {
    Status.CONVERGED.value: "#3a9a8a",
    Status.POORLY_DETERMINED.value: "#d9b23c",
    Status.AMBIGUOUS.value: "#6fb4e8",
    Status.NOT_CONVERGED.value: "#c8425a",
    Status.LEFT_FIELD.value: "#6a63c9",
    Status.NOT_FITTED.value: "#8b929c",
    Status.ABSENT.value: "#b05cab",
    Status.CUT.value: "#8f8f35",
    Status.BROKEN.value: "#8e2f62",
    Status.DEFORMED.value: "#e0876a",
}
"""After P. Tol's muted scheme, which colour-blind readers tell apart; a little lighter for dark pages."""
