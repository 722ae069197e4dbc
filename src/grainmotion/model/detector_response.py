"""Response of the detector: measured line integrals as a function of the modelled ones, view by view.

The paper's gain a and offset b (Eq. 22 of Khalili et al. 2017), with a low-order background in each view and beam
hardening as a polynomial of the line integral.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.errors import InputError
from grainmotion.model.summary import Summarised

Trend = Literal["none", "constant", "linear", "quadratic"]
TREND_TERMS: dict[Trend, int] = {"none": 0, "constant": 1, "linear": 3, "quadratic": 6}
"""Number of terms of each background: 1; 1, x, y; 1, x, y, x², xy, y²."""


@dataclass(frozen=True, eq=False, repr=False)
class Response(Summarised):
    """m = Σₖ polynomial[v, k − 1] pᵏ + Σⱼ background[v, j] φⱼ(x, y), for the line integral p of view v.

    x and y run over the panel's columns and rows from −1 to 1, and φ = 1, x, y, x², xy, y².

    Attributes
    ----------
    polynomial : (views, degree) array
        The first column holds the gains; the others are beam hardening.
    background : (views, terms) array
        Line-integral units; 0, 1, 3 or 6 terms.
    """

    polynomial: NDArray[np.float64]
    background: NDArray[np.float64]

    def __post_init__(self) -> None:
        polynomial, background = np.asarray(self.polynomial, float), np.asarray(self.background, float)
        if polynomial.ndim != 2 or polynomial.shape[1] < 1 or background.shape[:1] != polynomial.shape[:1]:
            fact = f"coefficients of shapes {polynomial.shape} and {background.shape}"
            raise InputError("response", fact, "give (views, degree) and (views, terms)")
        if background.ndim != 2 or background.shape[1] not in TREND_TERMS.values():
            raise InputError("response.background", f"shape {background.shape}", "give (views, 0, 1, 3 or 6)")
        object.__setattr__(self, "polynomial", polynomial)
        object.__setattr__(self, "background", background)

    @classmethod
    def identity(cls, views: int) -> Response:
        """m = p."""
        return cls(np.ones((views, 1)), np.zeros((views, 0)))

    @property
    def gain(self) -> float:
        """Mean gain over the views, the paper's a."""
        return float(self.polynomial[:, 0].mean())

    @property
    def offset(self) -> float:
        """Mean constant background over the views, the paper's b."""
        return float(self.background[:, 0].mean()) if self.background.shape[1] else 0.0

    def apply(self, path: Image) -> Image:
        """Measured line integrals ``(views, rows, columns)`` of simulated ones."""
        out = np.zeros_like(path)
        for coefficients in self.polynomial.T[::-1]:
            out += coefficients.astype(path.dtype)[:, None, None]
            out *= path
        for term, coefficients in zip(trend_terms(path.shape[1:], self.background.shape[1]), self.background.T):
            out += coefficients.astype(path.dtype)[:, None, None] * term.astype(path.dtype)
        return out

    def derivative(self, path: Image) -> Image:
        """∂m/∂p ``(views, rows, columns)``."""
        out = np.zeros_like(path)
        degree = self.polynomial.shape[1]
        for k in range(degree, 0, -1):
            if k < degree:
                out *= path
            out += (k * self.polynomial[:, k - 1]).astype(path.dtype)[:, None, None]
        return out

    def is_monotone(self, largest: float) -> bool:
        """Whether ∂m/∂p > 0 in every view for 0 ≤ p ≤ ``largest``."""
        degree = self.polynomial.shape[1]
        powers = np.linspace(0, max(largest, 0.0), 33)[:, None] ** np.arange(degree)
        return bool(np.all(powers @ (self.polynomial * np.arange(1, degree + 1)).T > 0))


def trend_terms(shape: tuple[int, ...], count: int) -> list[NDArray[np.float64]]:
    """The first ``count`` of 1, x, y, x², xy, y² over a panel of (rows, columns) pixels."""
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) if n > 1 else np.zeros(1) for n in shape), indexing="ij")
    return [np.ones_like(x), x, y, x * x, x * y, y * y][:count]
