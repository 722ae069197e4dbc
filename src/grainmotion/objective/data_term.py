"""The data term: the radiographs of a state, weighted and filtered, and how simulated ones are compared with them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Literal

import numpy as np

from grainmotion._typing import Float, Image, Projector
from grainmotion.backends.base import PatchBackend
from grainmotion.backends.cpu import CPU
from grainmotion.model.detector_response import trend_terms
from grainmotion.model.scan import Scan
from grainmotion.model.scene import NO_MOTION
from grainmotion.objective.global_parameters import Columns
from grainmotion.objective.nuisance_motions import GRAINS_ONLY, NuisanceModel
from grainmotion.objective.response_parameters import IDENTITY_RESPONSE, ResponseModel, trend_is_shared
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import body_image

Derivatives = Literal["analytic", "differences"]

EXPECTED_RESIDUAL_SHARE = 0.01
"""Smallest residual to expect, as a share of the radiographs' rms."""


@dataclass(frozen=True, eq=False)
class Target:
    """The radiographs to fit, and how simulated ones are compared with them.

    ``fixed_background (views, rows, columns)`` are line integrals of all bodies that may not move, and ``bodies`` are
    all of them, one row each, those that may move too; ``sigma`` is the width of the Gaussian filter, pixels;
    ``response_model`` and ``nuisance`` select the unknowns beside the grains' motions; ``weights`` are those of
    pixels, None if equal, and ``discount`` is a factor on them, at most 1, where the model's errors are alike over many
    pixels (None: nowhere); ``backend`` filters radiographs; ``fluid (views, rows, columns)`` are line integrals of
    a liquid as if no grain were in it (None: there is none), and ``fluid_columns`` derivatives of all line integrals by
    its unknowns, which enter linearly.  ``other_squares (views, rows, columns)`` are ΣP² of grains that are none of
    the problem's, as their small misfits stay in the radiographs (None: there are none).
    """

    scan: Scan
    fixed_background: Image
    projector: Projector
    sigma: float
    response_model: ResponseModel = IDENTITY_RESPONSE
    derivatives: Derivatives = "analytic"
    weights: Image | None = None
    discount: Image | None = None
    bodies: tuple[GrainArrays, ...] = ()
    nuisance: NuisanceModel = GRAINS_ONLY
    backend: PatchBackend = CPU
    fluid: Image | None = None
    fluid_columns: tuple[Image, ...] = ()
    other_squares: Image | None = None

    @property
    def precision(self) -> np.dtype[np.floating]:
        """The precision of the arithmetic: that of the simulated radiographs."""
        return self.fixed_background.dtype

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
    def root_weights(self) -> Image:
        """Square root of each pixel's weight, 0 where it does not count."""
        factors = [np.sqrt(w).astype(self.precision) for w in (self.weights, self.discount) if w is not None]
        return reduce(np.multiply, factors, self.valid)

    @cached_property
    def trust(self) -> Image:
        """Of each pixel how far its residual shows something about the grains: ``valid`` with the discount."""
        return self.valid if self.discount is None else self.valid * self.discount.astype(self.precision)

    @cached_property
    def measured(self) -> Image:
        """Weighted and filtered radiographs."""
        return self.filtered(self.scan.line_integrals.astype(self.precision))

    @cached_property
    def expected_variance(self) -> float:
        """Smallest variance to expect of a pixel's residual: the unit of the nuisance prior."""
        return EXPECTED_RESIDUAL_SHARE**2 * float(np.mean(self.measured.astype(float) ** 2))

    @cached_property
    def trends(self) -> Columns:
        """The terms of the background trend, weighted and filtered."""
        columns = Columns()
        for term in trend_terms(self.valid.shape[1:], self.response_model.trend_terms):
            stack = np.broadcast_to(term, self.valid.shape).astype(self.precision)
            columns.add(self.filtered(stack), trend_is_shared(self.response_model))
        return columns

    def with_fixed_bodies(self, rows: Collection[int]) -> Target:
        """The same with some more bodies that may not move from where they were in the reference."""
        freedoms, fixed = list(self.nuisance.freedoms), self.fixed_background.copy()
        for row in rows:
            freedoms[row] = NO_MOTION
            fixed += body_image(self.bodies[row], np.zeros(3), np.eye(3), self.scan.geometry, self.projector)
        return replace(self, fixed_background=fixed, nuisance=replace(self.nuisance, freedoms=tuple(freedoms)))

    @cached_property
    def filtered_fluid_columns(self) -> Columns:
        """The derivatives by a liquid's unknowns, weighted and filtered."""
        columns = Columns()
        for stack in self.fluid_columns:
            columns.add(self.filtered(stack), shared=True)
        return columns

    def filtered(self, images: Image) -> Image:
        """Weight and filter a stack of radiographs."""
        out = images * self.root_weights
        if len(self.kernel) > 1:
            self.backend.filter_images(out, self.kernel)
        return out


def gaussian(sigma: float) -> Float:
    """Half of a Gaussian kernel (σ in pixels), cut at 3σ, of unit sum over both halves; [1] for σ = 0."""
    if sigma <= 0:
        return np.ones(1)
    k = np.exp(-0.5 * (np.arange(int(np.ceil(3 * sigma)) + 1) / sigma) ** 2)
    return k / (2 * k.sum() - k[0])
