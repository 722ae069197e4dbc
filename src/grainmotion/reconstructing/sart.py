"""Plain SART: one update a view, in golden-ratio order, with a relaxation that falls from sweep to sweep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from grainmotion.reconstructing.card import CardEquations
from grainmotion.reconstructing.equations import Equations, golden_order, relative
from grainmotion.reconstructing.settings import ReconstructSettings

Progress = Callable[[str, int, int], None]

SWEEPS, RELAXATION, DECAY, TOLERANCE = 6, 1.0, 0.5, 0.02
"""Unless the settings say otherwise."""


def plain_sart(equations: Equations | CardEquations, progress: Progress | None) -> tuple[Any, list[float]]:
    """The image, laid, and ε of each sweep, each view just before its update."""
    settings = equations.settings
    sweeps = SWEEPS if settings.sweeps is None else settings.sweeps
    first = RELAXATION if settings.relaxation is None else settings.relaxation
    decay = DECAY if settings.decay is None else settings.decay
    image, order = equations.start(), golden_order(len(equations.scan))
    history: list[float] = []
    for sweep in range(sweeps):
        squares: Any = np.zeros(2)
        for done, view in enumerate(order, start=1):
            squares = squares + equations.add_update(image, np.array([view]), first * decay**sweep)
            equations.constrain(image)
            if progress is not None:
                message = f"SART sweep {sweep + 1}/{sweeps}, ε = {relative(squares):.4f}"
                progress(message, sweep * len(order) + done, sweeps * len(order))
        history.append(relative(squares))
        if _settled(history, settings):
            break
    return image, history


def _settled(history: list[float], settings: ReconstructSettings) -> bool:
    if settings.noise is not None and history[-1] <= settings.noise:
        return True
    tolerance = TOLERANCE if settings.tolerance is None else settings.tolerance
    return len(history) > 1 and history[-1] > history[-2] * (1 - tolerance)
