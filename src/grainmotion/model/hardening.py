"""Hardening: the curve from measured line integrals to those that a monochromatic beam would have given."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.scan import Scan

SIGNIFICANT_SD = 3.0
"""Standard deviations from which a departure from linear is significant."""


@dataclasses.dataclass(frozen=True)
class Hardening:
    """The curve g(b) = Σ c_k bᵏ from measured to linear line integrals.

    Attributes
    ----------
    coefficients : tuple of float
        c₁ = 1, c₂, …, none negative.
    longest : float
        Line integral up to which the curve was fitted; 99.5 % of those of the sample lie below.
    sd : float
        Standard deviation of `departure`.

    Examples
    --------
    >>> curve = gm.Hardening((1.0, 0.1), longest=2.0)
    >>> curve.is_linear
    False
    """

    coefficients: tuple[float, ...] = (1.0,)
    longest: float = 0.0
    sd: float = 0.0

    def __post_init__(self) -> None:
        c = self.coefficients
        if not c or c[0] != 1 or min(c) < 0 or not np.isfinite(c).all():
            raise InputError("hardening", f"coefficients {c}", "the first must be 1, and none may be negative")

    @property
    def is_linear(self) -> bool:
        """Whether the curve is the identity."""
        return not any(self.coefficients[1:])

    @property
    def departure(self) -> float:
        """How far the longest path is from linear: g(b)/b − 1."""
        return float(self(np.array(self.longest)) / self.longest - 1) if self.longest > 0 else 0.0

    def __call__(self, line_integrals: NDArray[np.floating]) -> NDArray[np.floating]:
        """g(b), in the precision of b; negative values, which are noise, stay as they are."""
        b = np.maximum(line_integrals, 0)
        higher = np.zeros_like(b)
        for c in self.coefficients[:0:-1]:
            higher = b * (higher + b.dtype.type(c))
        return line_integrals + b * higher

    def apply(self, scan: Scan) -> Scan:
        """Linearise a scan.

        Parameters
        ----------
        scan : Scan
            As measured.

        Returns
        -------
        Scan
            Its line integrals as a monochromatic beam would have given them.
        """
        if self.is_linear:
            return scan
        images = large_empty(scan.line_integrals.shape, scan.line_integrals.dtype)
        for image, measured in zip(images, scan.line_integrals, strict=True):
            image[:] = self(measured)
        return dataclasses.replace(scan, line_integrals=images)

    def __str__(self) -> str:
        if self.is_linear:
            return f"no beam hardening beyond {SIGNIFICANT_SD:.0f} sd ({100 * self.sd:.2g} %)"
        return f"beam hardening of {100 * self.departure:.1f} ± {100 * self.sd:.1f} % on the longest path"


LINEAR = Hardening()
"""No beam hardening: line integrals stay as they are."""
