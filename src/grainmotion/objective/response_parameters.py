"""Freedom: which numbers of the detector's response are unknown, and their elimination.

They enter linearly, so at every pose they are minimised over exactly (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grainmotion._typing import Image
from grainmotion.model.detector_response import TREND_TERMS, Response, Trend
from grainmotion.objective.global_parameters import Columns
from grainmotion.solvers.semidefinite import pseudo_inverse

Gain = Literal["none", "global", "view"]


@dataclass(frozen=True)
class ResponseModel:
    """What of the response is unknown.

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
    def terms(self) -> int:
        """Terms of the background."""
        return max(TREND_TERMS[self.trend], int(self.gain != "none"))

    @property
    def at_first(self) -> ResponseModel:
        """What is unknown while grains are far from their places: a misplaced shadow could pass for a gain."""
        return ResponseModel(trend="none" if self.trend == "none" else "constant")

    @property
    def without_gain(self) -> ResponseModel:
        """The same but for the gain, which is 1."""
        return ResponseModel(trend="constant" if self.trend == "none" else self.trend)

    @property
    def midway(self) -> ResponseModel:
        """What is unknown once they are near: all but beam hardening."""
        return replace(self, degree=1)


KNOWN = ResponseModel()
"""Nothing: measured line integrals are the simulated ones."""
DRIFT = ResponseModel("global")
"""A global gain and offset, a and b of Eq. 22."""


def powers(freedom: ResponseModel, path: Image) -> list[tuple[Image, bool]]:
    """Images of the unknowns that are powers of the line integral, and whether the views share them."""
    found = [(path, freedom.gain == "global")] if freedom.gain != "none" else []
    return found + [(path**k, True) for k in range(2, freedom.degree + 1)]


def trends_shared(freedom: ResponseModel) -> bool:
    """Whether the background's terms are the same in all views."""
    return freedom.trend == "none" and freedom.gain == "global"


def eliminated(freedom: ResponseModel, columns: Columns, gap: Image, views: int) -> tuple[Response, Image | float]:
    """The response that minimises ‖gap − C c‖, and C c.

    Parameters
    ----------
    freedom : Freedom
    columns : Columns
        Of the powers, then of the background's terms.
    gap : (views, rows, columns) array
        Measured minus simulated, weighted and filtered.
    views : int
    """
    polynomial, background = np.zeros((views, freedom.degree)), np.zeros((views, freedom.terms))
    polynomial[:, 0] = 1.0
    if not columns.stacks or (freedom.gain != "none" and not columns.stacks[0].any()):  # nothing is simulated
        return Response(polynomial, background), 0.0
    found = pseudo_inverse(columns.gram()) @ columns.dot(gap)
    owners = columns.owners
    first = 0 if freedom.gain != "none" else 1
    many = freedom.degree - first
    for k in range(len(columns.stacks)):
        if k < many:
            polynomial[:, first + k] += found[owners == k]
        else:
            background[:, k - many] = found[owners == k]
    return Response(polynomial, background), columns.combine(found)
