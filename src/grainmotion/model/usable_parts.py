"""Which parts of a grain's motion, translation and rotation, are results to use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.status import Status

PARTIAL = (Status.CUT.value, Status.DEFORMED.value, Status.BROKEN.value)
"""Statuses of grains whose translation or rotation may be a result to use; the classification says which."""
POORLY_DETERMINED_REASON = "poorly determined: "
"""Beginning of the reason of a poorly determined grain; what is not determined follows, up to a semicolon."""


def parts_to_use(
    statuses: NDArray[np.str_], reasons: tuple[str, ...], translation: NDArray[np.bool_], rotation: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Translations and rotations to use, as far as statuses and reasons decide it, else as given."""
    n = len(statuses)
    # flags of another length were not given, or `replace` kept them while all else is of other grains
    translation, rotation = (
        given.astype(bool) if given.shape == (n,) else np.zeros(n, dtype=bool)
        for given in (np.asarray(translation), np.asarray(rotation))
    )
    poor = statuses == Status.POORLY_DETERMINED.value
    whole = poor & translation & rotation  # a contradiction: the status is newer
    named = [r.partition(";")[0] if r.startswith(POORLY_DETERMINED_REASON) else "" for r in reasons]
    told = poor & np.array([bool(name) for name in named], dtype=bool)
    ok, ambiguous = statuses == Status.CONVERGED.value, statuses == Status.AMBIGUOUS.value
    partial = poor & ~whole | np.isin(statuses, PARTIAL)
    for flags, part, always in ((translation, "translation", ok | ambiguous), (rotation, "rotation", ok)):
        by_name = np.array([part not in name for name in named], dtype=bool)
        flags[:] = always | np.where(told, by_name, flags & partial)
    return translation, rotation
