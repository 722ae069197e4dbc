"""Which numbers of the detector's response are unknown, and their elimination.

They enter linearly, so at every pose they are minimised over exactly (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.model.detector_response import TREND_TERMS, Response, Trend
from grainmotion.objective.global_parameters import Columns
from grainmotion.solvers.semidefinite import pseudo_inverse

Gain = Literal["none", "global", "view"]


@dataclass(frozen=True)
class ResponseModel:
    """Which numbers of the response are unknown.

    Attributes
    ----------
    gain : {"none", "global", "view"}
        One gain for all views, or one a view.  Where ``trend`` is "none", an offset goes with it.
    trend : {"none", "constant", "linear", "quadratic"}
        A polynomial background in each view.
    degree : int
        Of the polynomial of beam hardening, shared by the views; 1 is none.
    """

    gain: Gain = "none"
    trend: Trend = "none"
    degree: int = 1

    @property
    def trend_terms(self) -> int:
        """Terms of the background trend."""
        return max(TREND_TERMS[self.trend], int(self.gain != "none"))

    @property
    def while_far(self) -> ResponseModel:
        """The unknowns while grains are far from their places: a misplaced grain could pass for a gain."""
        return ResponseModel(trend="none" if self.trend == "none" else "constant")

    @property
    def without_gain(self) -> ResponseModel:
        """The same with a gain of 1."""
        return ResponseModel(trend="constant" if self.trend == "none" else self.trend)

    @property
    def without_hardening(self) -> ResponseModel:
        """The same without beam hardening."""
        return replace(self, degree=1)


IDENTITY_RESPONSE = ResponseModel()
"""No unknown: measured line integrals are the simulated ones."""


def power_images(model: ResponseModel, path: Image) -> list[tuple[Image, bool]]:
    """Images of the unknowns that are powers of the line integrals, and whether the views share them."""
    first = [(path, model.gain == "global")] if model.gain != "none" else []
    return first + [(path**k, True) for k in range(2, model.degree + 1)]


def trend_is_shared(model: ResponseModel) -> bool:
    """Whether the terms of the background trend are the same in all views."""
    return model.trend == "none" and model.gain == "global"


def fit_response(
    model: ResponseModel, columns: Columns, gap: Image, views: int
) -> tuple[Response, Image | float, Float]:
    """The response that minimises ‖gap − C c‖, C c, and the coefficients of further columns.

    ``columns`` are C, those of the powers before those of the trend, then any others, which all views share; ``gap
    (views, rows, columns)`` is measured minus simulated, weighted and filtered.
    """
    polynomial, background = np.zeros((views, model.degree)), np.zeros((views, model.trend_terms))
    polynomial[:, 0] = 1.0
    if not columns.stacks or (model.gain != "none" and not columns.stacks[0].any()):  # nothing is simulated
        return Response(polynomial, background), 0.0, np.zeros(0)
    coefficients = pseudo_inverse(columns.gram()) @ columns.dot(gap)
    owners = columns.owners
    first = 0 if model.gain != "none" else 1
    powers = model.degree - first
    for k in range(len(columns.stacks)):
        if k < powers:
            polynomial[:, first + k] += coefficients[owners == k]
        elif k - powers < model.trend_terms:
            background[:, k - powers] = coefficients[owners == k]
    others = coefficients[owners >= powers + model.trend_terms]
    return Response(polynomial, background), columns.combine(coefficients), others
