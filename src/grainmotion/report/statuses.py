"""How the page names, explains and colours the outcomes of a fit."""

from __future__ import annotations

from grainmotion.model.motions import Status
from grainmotion.model.status import STATUS_COLOURS

STATUS_MEANINGS = {
    Status.CONVERGED.value: "translation and rotation are results to use",
    Status.POORLY_DETERMINED.value: "the radiographs do not fix all six components; the reason names which",
    Status.AMBIGUOUS.value: "several orientations explain the radiographs equally well; the translation is to be used",
    Status.NOT_CONVERGED.value: "the fit did not come to an end, or ended where the radiographs are not explained",
    Status.LEFT_FIELD.value: "the grain left the field of view of the radiographs",
    Status.NOT_FITTED.value: "the grain was left out of the fit; the reason says why",
    Status.ABSENT.value: "the grain is not in this state any more",
    Status.CUT.value: "the field of view cuts the grain off, so that a part of it was fitted",
    Status.BROKEN.value: "the grain broke; its pieces are listed under Fit",
    Status.DEFORMED.value: "the grain changed its shape",
}


def status_records() -> list[dict[str, str]]:
    """Name, meaning and colour of each status, in the order of `Status`."""
    return [
        {
            "name": status.value,
            "meaning": STATUS_MEANINGS[status.value],
            "colour": STATUS_COLOURS[status.value],
        }
        for status in Status
    ]
