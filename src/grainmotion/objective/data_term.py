"""What is fitted: the radiographs of a state, weighted and filtered, and how they are compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from grainmotion._typing import Float, Image, Projector
from grainmotion.backends.device import CPU, Device
from grainmotion.backends.patchwork import filter_images
from grainmotion.model.detector_response import trend_terms
from grainmotion.model.scan import Scan
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.nuisance_motions import STILL, NuisanceModel
from grainmotion.objective.response_parameters import KNOWN, ResponseModel, trends_shared
from grainmotion.projection.grain_arrays import GrainArrays

Derivatives = Literal["analytic", "differences"]


@dataclass(frozen=True, eq=False)
class Target:
    """What is fitted: radiographs, what of them does not move, and how they are compared.

    ``fixed`` is the background's line integrals where nothing moved, ``body`` the background itself if it can
    move; ``freedom`` says which numbers of the response are unknown, ``loose`` what of the surroundings is;
    ``derivatives`` says how those of P are taken; ``weights (views, rows, columns)`` count pixels (None: all
    alike); ``device`` filters radiographs.
    """

    scan: Scan
    fixed: Image
    projector: Projector
    sigma: float
    freedom: ResponseModel = KNOWN
    derivatives: Derivatives = "analytic"
    weights: Image | None = None
    body: GrainArrays | None = None
    loose: NuisanceModel = STILL
    device: Device = CPU

    @property
    def precision(self) -> np.dtype[np.floating]:
        """The precision of the arithmetic: that of what is simulated."""
        return self.fixed.dtype

    @cached_property
    def kernel(self) -> Image:
        """Half of the Gaussian's kernel, cut at 3σ, of unit sum."""
        return gaussian(self.sigma).astype(self.precision)

    @cached_property
    def valid(self) -> Image:
        """1 where a pixel counts, 0 where not."""
        if self.scan.valid is None:
            return np.ones(self.scan.line_integrals.shape, self.precision)
        return self.scan.valid.astype(self.precision)

    @cached_property
    def roots(self) -> Image:
        """Root of each pixel's weight, 0 where it does not count."""
        return self.valid if self.weights is None else self.valid * np.sqrt(self.weights).astype(self.precision)

    @cached_property
    def measured(self) -> Image:
        """Weighted and filtered radiographs."""
        return self.filtered(self.scan.line_integrals.astype(self.precision))

    @cached_property
    def trends(self) -> Columns:
        """The background's terms, weighted and filtered."""
        columns = Columns()
        for term in trend_terms(self.valid.shape[1:], self.freedom.terms):
            stack = np.broadcast_to(term, self.valid.shape).astype(self.precision)
            columns.add(self.filtered(stack), trends_shared(self.freedom))
        return columns

    def filtered(self, images: Image) -> Image:
        """Weight and filter a stack of radiographs."""
        out = images * self.roots
        if len(self.kernel) > 1:
            filter_images(out, self.kernel, self.device)
        return out


def gaussian(sigma: float) -> Float:
    """Half of a Gaussian kernel (σ in pixels), cut at 3σ, of unit sum over both halves; [1] for σ = 0."""
    if sigma <= 0:
        return np.ones(1)
    k = np.exp(-0.5 * (np.arange(int(np.ceil(3 * sigma)) + 1) / sigma) ** 2)
    return k / (2 * k.sum() - k[0])
