"""What of a state is fitted, how it is compared with what grains cast, and who works that out.

r = F w (b − m(P)) with P the line integrals of the moved grains and the background, m the detector's response, w
the root of each pixel's weight and F a Gaussian on each radiograph; derivatives are treated as the residual is.
All that touches the grains' voxels is in `cast`, all that touches whole radiographs is here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from grainmotion.grains import GrainSet
from grainmotion.kernels import normal
from grainmotion.packed import Image, PackedGrains, Pose
from grainmotion.project import Projector, assemble
from grainmotion.response import Response, trend_terms
from grainmotion.scan import Scan
from grainmotion.solve import Linearization
from grainmotion.tracking import surroundings
from grainmotion.tracking.cast import Cast, Derivatives, Shown, Walk
from grainmotion.tracking.columns import Columns
from grainmotion.tracking.freedom import KNOWN, Freedom, eliminated, powers, trends_shared
from grainmotion.tracking.surroundings import STILL, Loose

Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Target:
    """What is fitted: radiographs, what of them does not move, and how they are compared.

    ``fixed`` is the background's line integrals where nothing moved, ``body`` the background itself if it can
    move; ``freedom`` says which numbers of the response are unknown, ``loose`` what of the surroundings is;
    ``derivatives`` says how those of P are taken; ``weights (views, rows, columns)`` count pixels (None: all
    alike).
    """

    scan: Scan
    fixed: Image
    projector: Projector
    sigma: float
    freedom: Freedom = KNOWN
    derivatives: Derivatives = "analytic"
    weights: Image | None = None
    body: PackedGrains | None = None
    loose: Loose = STILL
    crew: Crew = field(default_factory=lambda: ALONE)

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
            normal.filter_images(out, self.kernel)
        return out

    def walk(self, pose: Pose) -> Walk:
        """How grains are walked at a pose, whose surroundings move the views."""
        geometry = surroundings.corrected(self.scan.geometry, pose.surroundings)
        return Walk(geometry, self.projector, self.derivatives, len(self.kernel) - 1)

    def compare(self, pose: Pose, path: Image, turned: Image | None) -> Compared:
        """Compare with the measured radiographs.

        ``path`` are the grains' line integrals ``(views, rows, columns)``, ``turned`` their derivatives by the
        stage's angle if views are loose; of the pose, the surroundings alone count.
        """
        loose, around = self.loose, pose.surroundings
        still, stacks = self.fixed, list[Image]()
        if self.body is not None and (loose.body or loose.views or around is not None):
            geometry = surroundings.corrected(self.scan.geometry, around)
            moves = loose.body or loose.views
            still, stacks = surroundings.background_images(self.body, around, geometry, self.projector, moves)
        path = path + still
        response, simulated, linear = self._respond(path)
        slope = response.slope(path)
        moving = Columns()
        if loose.views:
            assert turned is not None
            images = [*surroundings.shifted(path), turned]
            if self.body is not None:
                images[2] = images[2] + surroundings.turned_background(self.body, around, stacks)
            for image in images:
                moving.add(self.filtered(slope * image), shared=False)
        for stack in stacks if loose.body else []:
            moving.add(self.filtered(slope * stack), shared=True)
        raw = (self.scan.line_integrals.astype(self.precision) - response.apply(path)) * self.valid
        residual, factor = self.measured - simulated, self.roots * slope
        return Compared(residual, simulated, path, raw, response, linear, moving, factor)

    def _respond(self, path: Image) -> tuple[Response, Image, Columns]:
        """The best response to the line integrals of the model, what it gives, and the columns eliminated.

        A polynomial that is not monotone is no response: its degree is lowered until it is, the gain fixed last.
        """
        plain = self.filtered(path)
        freedom, views = self.freedom, len(path)
        while True:
            linear = Columns()
            for k, (power, shared) in enumerate(powers(freedom, path)):
                first = k == 0 and freedom.gain != "none"
                linear.add(plain if first else self.filtered(power), shared)
            linear = linear + self.trends
            response, more = eliminated(freedom, linear, self.measured - plain, views)
            if response.is_monotone(float(path.max(initial=0.0))) or (freedom.gain == "none" and freedom.degree == 1):
                return response, plain + more, linear
            lower = replace(freedom, degree=freedom.degree - 1)
            freedom = lower if freedom.degree > 1 else freedom.without_gain


@dataclass(frozen=True, eq=False)
class Compared:
    """Radiographs simulated at a pose, beside the measured ones.

    ``residual`` and ``simulated`` are weighted and filtered, ``path`` (P) and ``raw`` (b − m(P), 0 where a
    pixel does not count) are not; ``linear`` are eliminated unknowns, ``loose`` those of the surroundings;
    ``factor`` takes derivatives of P to weighted ones of m(P).
    """

    residual: Image
    simulated: Image
    path: Image
    raw: Image
    response: Response
    linear: Columns
    loose: Columns
    factor: Image

    @property
    def columns(self) -> Columns:
        """All unknowns that all grains share."""
        return self.linear + self.loose

    @property
    def cost(self) -> float:
        """½‖r‖²."""
        return 0.5 * float(np.vdot(self.residual, self.residual))


@dataclass(frozen=True, eq=False)
class Seen(Compared):
    """Everything that one evaluation at a pose yields: ``cast`` is what the grains cast, derivatives those of m(P)."""

    cast: Shown

    @classmethod
    def of(cls, cast: Shown, compared: Compared) -> Seen:
        """Both halves of an evaluation."""
        return cls(**{f.name: getattr(compared, f.name) for f in fields(Compared)}, cast=cast)

    def linearization(self) -> Linearization:
        """Cost, gradient and normal matrix, without priors."""
        columns = self.columns
        gradient = -self.cast.border(Columns([self.residual], [True]))[:, 0]
        border, hessian = self.cast.border(columns), self.cast.normal_matrix()
        return Linearization(self.cost, gradient, hessian, border, columns.gram(), -self.loose.dot(self.residual))


class Crew(Protocol):
    """Who works a state out: this process, or many (see `grainmotion.cluster`)."""

    def pack(self, grains: GrainSet, fine: bool) -> PackedGrains:
        """The grains as arrays, or their finer ones if all have some."""
        ...

    def look(self, grains: PackedGrains, target: Target, pose: Pose) -> Seen:
        """Simulate, compare and differentiate at a pose."""
        ...

    def linearize(self, grains: PackedGrains, target: Target, pose: Pose) -> Linearization:
        """Cost, gradient and normal matrix at a pose, without priors."""
        ...

    def each(self, grains: PackedGrains, pose: Pose, function: Callable[..., Float], *images: Image) -> Float:
        """``function(grains, pose, *images)``, one row a grain."""
        ...


class Alone:
    """This process."""

    def pack(self, grains: GrainSet, fine: bool) -> PackedGrains:
        """See `Crew`."""
        return PackedGrains.of(grains, fine)

    def look(self, grains: PackedGrains, target: Target, pose: Pose) -> Seen:
        """See `Crew`."""
        walk = target.walk(pose)
        cast = Cast.of(grains, pose, walk)
        path = assemble(cast.values, cast.patches, walk.geometry)
        turned = assemble(cast.turned(), cast.patches, walk.geometry) if target.loose.views else None
        compared = target.compare(pose, path, turned)
        cast.filter(compared.factor, target.kernel)
        return Seen.of(cast, compared)

    def linearize(self, grains: PackedGrains, target: Target, pose: Pose) -> Linearization:
        """See `Crew`."""
        return self.look(grains, target, pose).linearization()

    def each(self, grains: PackedGrains, pose: Pose, function: Callable[..., Float], *images: Image) -> Float:
        """See `Crew`."""
        return function(grains, pose, *images)


ALONE: Crew = Alone()


def gaussian(sigma: float) -> Float:
    """Half of a Gaussian kernel (σ in pixels), cut at 3σ, of unit sum over both halves; [1] for σ = 0."""
    if sigma <= 0:
        return np.ones(1)
    k = np.exp(-0.5 * (np.arange(int(np.ceil(3 * sigma)) + 1) / sigma) ** 2)
    return k / (2 * k.sum() - k[0])
