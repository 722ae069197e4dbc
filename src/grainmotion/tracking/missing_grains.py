"""Missing grains: those whose projection is not on the radiographs (fallen out, carried off the detector, or broken).

Such a grain disturbs the others: they move, and gain and offset change, to make up for attenuation that is in the
simulation alone.  With P its line integrals and r the residual at unit gain,

    support = 1 + r·P / ‖P‖²

is the share of P that the radiographs support: near 1 for a grain that is there, near 0 for one that is not (0.05 to
0.45 against 0.8 to 1 in trials, five grains, one of them taken away).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import ResponseModel

MIN_SUPPORT = 0.6
"""Support below which a grain that did not converge is suspected of being missing."""
MAX_SINGLE_SUSPECTS = 4
"""Suspects up to which each is left out alone."""
MAX_GRAINS_ALL_TRIED = 16
"""Largest sample of which each grain is left out in turn when most are in doubt; in a larger one a missing grain
disturbs only its neighbours, and trials without it start from the poses reached."""
MIN_PLAUSIBLE_GAIN, LACKING_GRAIN_SHARE = 0.4, 0.3
"""A fitted gain between the first number and 1 − (second number)/n suggests that one of n grains is missing."""
MISSING_MASS, BROKEN_SUPPORT, INTACT_MASS = 0.4, 0.4, (0.7, 1.3)
"""Mass below which a grain is missing; support above which, and mass between which, it is there but broken."""
MISSING_REASON = (
    "its shadow is not on the radiographs: the others fit better without it; check whether it is still there"
)


@dataclass(frozen=True)
class GrainSupport:
    """How far the radiographs support one grain's simulated projections.

    Attributes
    ----------
    share : float
        Share of its line integrals in the least squares sense; NaN where no view sees it.
    mass : float
        Attenuation that the others leave over in its footprint, over the grain's own; near 1 if all of it is there,
        whatever its shape.
    """

    share: float = np.nan
    mass: float = np.nan

    @property
    def sentence(self) -> str:
        """What is likely to have become of a grain that fits badly."""
        if self.mass < MISSING_MASS:
            return "little of its shadow is there, it is missing or far away"
        if INTACT_MASS[0] < self.mass < INTACT_MASS[1] and self.share > BROKEN_SUPPORT:
            return "its mass is there but not its shape, it is broken, deformed or badly segmented"
        return "wrong minimum, broken or badly segmented grain"


def grain_supports(problem: StateProblem, pose: Pose) -> list[GrainSupport]:
    """How far the radiographs support each grain's projections."""
    plain = replace(problem.target, sigma=0.0, response_model=ResponseModel(), weights=None, discount=None)
    evaluation = StateProblem(problem.grains, plain).evaluate(pose)
    sums = np.zeros((len(problem.grains), 4))
    for grain, own, (valid, residual) in evaluation.grain_pixels(problem.target.valid, evaluation.raw_residual):
        own *= valid
        sums[grain] += own @ residual, own @ own, residual.sum(), own.sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = 1 + sums[:, ::2] / sums[:, 1::2]
    return [GrainSupport(float(share), float(mass)) for share, mass in shares]


def suspects(measured: Motions, supports: Float) -> list[NDArray[np.int64]]:
    """Sets of rows to leave out in turn: grains that did not converge and have too little support.

    A few are left out one at a time, because one missing grain can disturb its neighbours; many are left out at once.
    If most of a sample is in doubt, one missing grain may have disturbed all: in a small sample each is tried; in a
    large one, or if no attenuation is lacking, none, because then the radiographs themselves are wrong.
    """
    unsettled = measured.statuses == Status.NOT_CONVERGED.value
    doubtful = np.nonzero(unsettled & (supports < MIN_SUPPORT))[0]
    doubtful = doubtful[np.argsort(supports[doubtful])]
    if unsettled.mean() > 0.5:
        small = 1 < len(measured) <= MAX_GRAINS_ALL_TRIED
        lacking = MIN_PLAUSIBLE_GAIN < measured.fit.gain < 1 - LACKING_GRAIN_SHARE / len(measured)
        return [np.array([k]) for k in range(len(measured))] if small and lacking else []
    if len(doubtful) > MAX_SINGLE_SUSPECTS:
        return [doubtful]
    return [doubtful[k : k + 1] for k in range(min(3, len(doubtful)))]


def registered(measured: Motions) -> NDArray[np.bool_]:
    """Grains that were found, ``(n,)``: their place is known, though a round one may have any rotation, or are cut."""
    return measured.ok_translation | (measured.statuses == Status.CUT.value)


def merit(measured: Motions) -> tuple[int, float]:
    """Sorts sets of grains, the best last: by how many converge, then by how little residual is left."""
    residual = measured.fit.costs[-1][1] if measured.fit.costs else np.inf
    return int(registered(measured).sum()), -residual


def improves(measured: Motions, before: Motions) -> bool:
    """Whether more grains converge, or as many with a residual that is clearly smaller."""
    (converged, residual), (converged_before, residual_before) = merit(measured), merit(before)
    return converged > converged_before or (converged == converged_before and residual > 0.8 * residual_before)


def complete(measured: Motions, grains: GrainSet) -> Motions:
    """Motions of all the grains from those of some; the others are absent."""
    motions = measured.for_grains(grains.labels, grains.centers)
    missing = ~np.isin(grains.labels, measured.labels)
    motions.translations[missing] = motions.rotations[missing] = np.nan
    motions.statuses[missing] = Status.ABSENT.value
    reasons = (MISSING_REASON if m else reason for m, reason in zip(missing, motions.reasons, strict=True))
    return replace(motions, reasons=tuple(reasons))
