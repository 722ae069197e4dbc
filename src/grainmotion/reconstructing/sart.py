"""Plain SART: one update a view, in golden-ratio order, with a relaxation that falls from sweep to sweep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from grainmotion.reconstructing.equations import Iterate, golden_order, relative
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.reconstructing.updates import updated

Progress = Callable[[str, int, int], None]

SWEEPS, RELAXATION, DECAY, TOLERANCE = 6, 1.0, 0.5, 0.02
"""Unless the settings say otherwise."""


def plain_sart(iterate: Iterate, views: int, settings: ReconstructSettings, progress: Progress | None) -> list[float]:
    """Update an image by a scan of so many views; ε of each sweep, each view just before its update."""
    sweeps = SWEEPS if settings.sweeps is None else settings.sweeps
    first = RELAXATION if settings.relaxation is None else settings.relaxation
    decay = DECAY if settings.decay is None else settings.decay
    order = golden_order(views)
    history: list[float] = []
    for sweep in range(sweeps):

        def tell(squares: Any, done: int, sweep: int = sweep) -> None:
            if progress is not None:
                message = f"SART sweep {sweep + 1}/{sweeps}, ε = {relative(squares):.4f}"
                progress(message, sweep * len(order) + done, sweeps * len(order))

        one_by_one = [(np.array([view]), first * decay**sweep) for view in order]
        history.append(relative(updated(iterate, one_by_one, 0.0, tell)))
        if _settled(history, settings):
            break
    return history


def _settled(history: list[float], settings: ReconstructSettings) -> bool:
    if settings.noise is not None and history[-1] <= settings.noise:
        return True
    tolerance = TOLERANCE if settings.tolerance is None else settings.tolerance
    return len(history) > 1 and history[-1] > history[-2] * (1 - tolerance)
