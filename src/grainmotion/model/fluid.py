"""Fluid: a liquid that fills the space between grains up to a level, and how a later state found it.

A grain in a liquid displaces it.  With φ the liquid's attenuation in the space that it can fill (0 above its level),
oᵢ the share of a voxel that grain i occupies and μᵢ its attenuation, both moved with the grain, a state attenuates

    μ(x) = φ(x) (1 − κ Σᵢ oᵢ(x)) + Σᵢ μᵢ(x),

with κ = 1 for grains that hold no liquid.  Grains of a wet reference hold their *excess* μᵢ − φ oᵢ, so that a liquid
that stayed as it was is one fixed image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.summary import Summarised
from grainmotion.model.volume import Volume

NO_ATTENUATION = 1e-12
"""1/mm: attenuation of a liquid that is gone."""


@dataclass(frozen=True, eq=False, repr=False)
class Fluid(Summarised):
    """A liquid between the grains.

    Attributes
    ----------
    attenuation : float
        1/mm.
    space : Volume
        Share (0 to 1) of each voxel that liquid and grains can fill, at any level: within the container's walls.
    level : float, optional
        Height z of its surface, mm; None if it fills the space up to the top of the field.

    Raises
    ------
    InputError
        If the attenuation is not positive, or the level not finite.
    """

    attenuation: float
    space: Volume
    level: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.attenuation) and self.attenuation > 0):
            raise InputError("fluid.attenuation", f"must be > 0, got {self.attenuation}", "give it in 1/mm")
        if self.level is not None and not np.isfinite(self.level):
            raise InputError("fluid.level", f"must be finite, got {self.level}", "give a height in mm, or none")

    @property
    def bottom(self) -> float:
        """Height of the lower face of the space, mm."""
        return float(self.space.origin[2] - self.space.voxel_size / 2)

    @property
    def top(self) -> float:
        """Height of the upper face of the space, mm."""
        return self.bottom + self.space.voxel_size * self.space.shape[0]

    @property
    def surface(self) -> float:
        """Height up to which it fills the space, mm."""
        return self.top if self.level is None else min(max(self.level, self.bottom), self.top)

    def changed(self, attenuation: float, level: float | None) -> Fluid:
        """The same space with another liquid, up to another level."""
        return replace(self, attenuation=attenuation, level=level)

    def found(self, fit: FluidFit) -> Fluid:
        """The liquid that a later state found."""
        level = None if np.isnan(fit.level) else fit.level
        return self.changed(max(fit.attenuation, NO_ATTENUATION), level)

    @property
    def volume(self) -> Volume:
        """Its attenuation as if no grain were in it, 1/mm."""
        z = self.space.origin[2] + self.space.voxel_size * np.arange(self.space.shape[0])
        below = below_level(z, self.surface, self.space.voxel_size).astype(self.space.array.dtype)
        array = self.space.array * (self.attenuation * below)[:, None, None]
        return replace(self.space, array=array.astype(self.space.array.dtype, copy=False))

    def layer(self, low: float, high: float) -> Volume:
        """The share of each voxel that lies between two heights (mm)."""
        z, h = self.space.origin[2] + self.space.voxel_size * np.arange(self.space.shape[0]), self.space.voxel_size
        share = (below_level(z, high, h) - below_level(z, low, h)).astype(self.space.array.dtype)
        return replace(self.space, array=self.space.array * share[:, None, None])


@dataclass(frozen=True)
class FluidFit:
    """The liquid of a later state.

    Attributes
    ----------
    attenuation, attenuation_sd : float
        1/mm; the standard deviation is NaN where it was not estimated.
    level, level_sd : float
        Height z of its surface, mm; NaN if it fills the space up to the top of the field.
    displaced, displaced_sd : float
        κ, the share of a grain's own place that does not take part when the liquid changes there: 1 for a solid
        grain, 1 − porosity for one whose pores fill and drain with the level.  NaN where nothing changed.
    """

    attenuation: float
    level: float = float("nan")
    displaced: float = float("nan")
    attenuation_sd: float = float("nan")
    level_sd: float = float("nan")
    displaced_sd: float = float("nan")


def below_level(z: NDArray[np.float64], level: float, thickness: float) -> NDArray[np.float64]:
    """Share of layers around heights ``z`` that lies below a level, all in one unit of length."""
    return np.asarray(np.clip((level - z) / thickness + 0.5, 0.0, 1.0))
