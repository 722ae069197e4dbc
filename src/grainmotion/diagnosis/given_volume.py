"""A volume made by other software, held against radiographs: units, axes, size, place, and whether it is the sample.

The radiographs are those of the reference if they are at hand, else of the first state, whose grains have moved a
little.  `coarse_projection` compares; each usual mistake is a changed volume that is compared alike.  A changed volume
that is clearly better is named, with both residuals.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion.diagnosis.coarse_projection import CoarseScan, Match, coarse_volume
from grainmotion.diagnosis.labels import check_labels
from grainmotion.diagnosis.orientations import (
    AS_GIVEN,
    ORIENTATIONS,
    Orientation,
    orientation_code,
    orientation_name,
    oriented,
)
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.quantiles import quantile_of_parts
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.volume_threshold import otsu

VOLUME_CHECK: Check = "given-volume"
GOOD_RESIDUAL = 0.12
"""Residual up to which no other orientation is tried."""
CLEARLY_BETTER = 0.65
"""Residual of another hypothesis over that of the volume as given, from which it is named."""
CLEAR_GAP = 0.9
"""Residual of the best orientation over that of the second best, from which it is named, if it is better than the
volume as given at all.  Mirrored volumes gave 0.34-0.85 (6 and 15 grains that moved by up to 4 voxels and 10°), volumes
of another sample 0.95-1, as their 48 orientations are all alike."""
VOXEL_SCALES = (0.5, 0.65, 0.8, 0.9, 0.95, 1.05, 1.1, 1.25, 1.5, 2.0)
"""Factors of the voxel size that are tried."""
SCALES_OF_THE_SAME_STATE = ((0.01, 0.15, 0.8),)
"""Error of the voxel size, residual without it and that over the residual with it, from which it is told: compared with
radiographs of the same state.
"""
SCALES_OF_ANOTHER_STATE = ((0.1, 0.35, 0.75),)
"""The same where grains have moved: motions of single grains by two voxels changed the best scale by up to 7 %;
`grain_scale` tells smaller errors after tracking."""
ATTENUATION_BY_SCALE = 2.5
"""Power of the voxel size by which the fitted attenuation falls: measured between 2.3 and 2.8."""
MAX_FACTOR_BY_SCALE = 4.0
"""Factor of the attenuation that a wrong voxel size may cause; beyond it scales are found by the residual."""
SCALE_WITH_GAIN = 0.92
"""Residual over that with the given voxels, from which a voxel size that explains the attenuation too is named."""
MAX_ATTENUATION_FACTOR = 1.6
"""Factor of the attenuation, either way, from which the work stops."""
NOTED_ATTENUATION_FACTOR = 1.3
"""The same, from which it is told."""
MAX_RESIDUAL_OF_FACTOR = 0.35
"""Residual up to which a factor of the attenuation, and a shift, are believed."""
MISSING_GRAINS = 0.3
"""Squared residual over the missing share of attenuation, from which grains are missing: 0.4 where they were taken
out.
"""
MIN_AIR_LEVEL = 0.05
"""Level of air, over the step from air to grains, from which it is tried whether it is an offset."""
MAX_SHARE_OUTSIDE = 0.1
"""Share of the radiographs' line integrals beside the volume, from which the volume is too small: 0.06 where a thin
container lies outside, 0.13 to 0.21 for half of a volume.
"""
SCALE_OF_A_WHOLE_SAMPLE = 0.5
"""Residual with other voxels over that with those given, up to which a volume with attenuation beside it has wrong
voxels: 0.23 to 0.34 where they were too small by a factor of 1.6 or 2, 0.61 to 0.89 where it was the middle of the
sample, which looks like all of it with larger voxels.
"""
UNLIKE_RESIDUAL = 0.25
"""Residual from which a volume that matches no better than its mirror images is another sample."""
UNLIKE_RATIO = 0.9
"""Residual of the best mirror image over that of the volume, up to which it is another sample: 0.95 and more where a
third of the grains or half of a liquid was taken out.
"""
MIN_SHIFT_VOXELS = 0.5
"""Shift against radiographs of the same state from which it is told, voxels."""
NOTED_SHIFT_VOXELS = 2.0
"""Shift against radiographs of another state from which it is told, voxels."""
UNIT_TOLERANCE = 0.15
"""A factor of the attenuation this near to that of another unit is taken for it."""


@dataclass(frozen=True, eq=False)
class _Comparison:
    """A volume, the radiographs, and which state they are of."""

    scan: CoarseScan
    volume: Volume  # coarse
    voxel_size: float  # as given
    same_state: bool
    where: str

    def finding(self, level: Level, fact: str, evidence: str = "", remedy: str = "") -> Finding:
        """A finding about the volume."""
        return Finding(level, VOLUME_CHECK, self.where, fact, evidence, remedy)

    def match(self, orientation: Orientation = AS_GIVEN, scale: float = 1.0) -> Match:
        """Match of the volume with its axes and voxels changed."""
        array, center = oriented(self.volume.array, orientation), self.volume.center
        return self.scan.match(Volume(array, scale * self.volume.voxel_size, center))


@checked_arguments
def check_volume(
    volume: Volume,
    labels: NDArray[np.integer] | None,
    scan: Scan,
    *,
    same_state: bool = False,
    where: str = "volume",
) -> tuple[Finding, ...]:
    """Findings about a reference volume, and labels, made by other software.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm, as given.
    labels : (nz, ny, nx) int array, optional
        Grains, 0 for none.
    scan : Scan
        Line integrals of the reference or of a later state.
    same_state : bool
        Whether the radiographs show the sample as the volume does.
    where : str
        File and key, for the findings.

    Returns
    -------
    tuple of Finding
        The worst are errors: results would be wrong.

    Examples
    --------
    The sample moved, so nothing but its mean motion is noticed:

    >>> [finding.level.value for finding in gm.check_volume(volume, labels, state)]
    ['note']
    """
    found = [] if labels is None else list(check_labels(volume, labels))
    if min(volume.shape) == 1 or float(np.ptp(volume.array)) == 0:
        return tuple(found)
    coarse = CoarseScan.of(scan, volume.center)
    small = coarse_volume(volume, coarse.pixel)
    compared = _Comparison(coarse.above_air(small), small, volume.voxel_size, same_state, where)
    return (*_compared(compared, volume), *found)


def _compared(given: _Comparison, volume: Volume) -> Iterable[Finding]:
    told = given.match()
    air, offset = _air_level(volume), False
    if air != 0:
        lowered = replace(given, volume=replace(given.volume, array=given.volume.array - np.float32(air)))
        match = lowered.match()
        if match.residual < CLEARLY_BETTER * told.residual:
            given, told, offset = lowered, match, True
    orientation, best, others = AS_GIVEN, told, []
    if told.residual > GOOD_RESIDUAL:
        others = [(given.match(o), o) for o in ORIENTATIONS[1:]]
        (first, name), (second, _) = sorted(others, key=lambda pair: pair[0].residual)[:2]
        limits = CLEARLY_BETTER * told.residual, min(UNLIKE_RATIO * told.residual, CLEAR_GAP * second.residual)
        if first.residual < max(limits):
            orientation, best = name, first
    scale, scaled = _best_scale(given, orientation, best)
    if scale > 1 and given.scan.share_outside(given.volume) > MAX_SHARE_OUTSIDE:
        scale = scale if scaled.residual < SCALE_OF_A_WHOLE_SAMPLE * best.residual else 1.0
    if orientation != AS_GIVEN:
        fact = f"the volume is {orientation_name(orientation)}, or the views of the radiographs are"
        remedy = f"give {orientation_code('volume', orientation)} and the labels alike, or correct first_row and angles"
        yield given.finding(Level.ERROR, fact, _evidence(told, best), remedy)
    final = scaled if scale != 1 else best
    share = given.scan.share_outside(replace(given.volume, voxel_size=scale * given.volume.voxel_size))
    if scale != 1 and share <= MAX_SHARE_OUTSIDE:
        yield from _scale_finding(given, scale, best, scaled)
    if share > MAX_SHARE_OUTSIDE:
        fact = "the volume is smaller than the sample: attenuation beside it is in no grain"
        evidence = f"{share:.0%} of the line integrals lie on rays that pass it by"
        yield given.finding(Level.WARNING, fact, evidence, "give a volume of the whole sample, or check voxel_size")
        return
    yield from _attenuation(given, final, air if offset else 0.0)
    if orientation == AS_GIVEN and scale == 1:
        yield from _unlike(given, told, others) or _place(given, told)


def _unlike(given: _Comparison, told: Match, others: list[tuple[Match, Orientation]]) -> list[Finding]:
    """A volume that matches no better than with its axes in another order is not this sample."""
    if told.residual <= UNLIKE_RESIDUAL or not others:
        return []
    best, orientation = min(others, key=lambda pair: pair[0].residual)
    if best.residual >= UNLIKE_RATIO * told.residual:
        return []
    name = orientation_name(orientation)
    fact = f"the volume does not look like the radiographs: another sample, wrong angles, or it is {name}"
    evidence = _evidence(told, best)
    return [given.finding(Level.WARNING, fact, evidence, "check that both are of one sample, and the geometry")]


def _evidence(told: Match, best: Match) -> str:
    return f"relative residual of its projection {told.residual:.2f}, and {best.residual:.2f} then"


def _air_level(volume: Volume) -> float:
    """Level of air in a volume if it is far from 0, else 0."""
    array = volume.array
    threshold = otsu(array)
    low = quantile_of_parts(lambda: (plane[plane <= threshold] for plane in array), 0.5)
    bright = [
        (float(plane[plane > threshold].sum(dtype=float)), np.count_nonzero(plane > threshold)) for plane in array
    ]
    high = sum(total for total, _ in bright) / sum(count for _, count in bright)
    return low if abs(low) > MIN_AIR_LEVEL * (high - low) else 0.0


def _best_scale(given: _Comparison, orientation: Orientation, now: Match) -> tuple[float, Match]:
    """Factor of the voxel size with the smallest residual, 1 if it isn't clear, and its match."""
    matches = {1.0: now} | {scale: given.match(orientation, scale) for scale in VOXEL_SCALES}
    scales = sorted(matches)
    k = min(range(len(scales)), key=lambda i: matches[scales[i]].residual)
    scale = scales[k]
    if 0 < k < len(scales) - 1:
        x = np.log(scales[k - 1 : k + 2])
        a, b, _ = np.polyfit(x, [matches[s].residual ** 2 for s in scales[k - 1 : k + 2]], 2)
        scale = float(np.exp(np.clip(-b / (2 * a), x[0], x[2]))) if a > 0 else scale
    match = given.match(orientation, scale)
    if match.residual > matches[scales[k]].residual:
        scale, match = scales[k], matches[scales[k]]
    limits = SCALES_OF_THE_SAME_STATE if given.same_state else SCALES_OF_ANOTHER_STATE
    for error, residual, ratio in limits:
        if abs(scale - 1) > error and match.residual < residual and match.residual < ratio * now.residual:
            return scale, match
    off = now.gain if now.gain > 1 else 1 / max(now.gain, 1e-9)
    if not given.same_state and NOTED_ATTENUATION_FACTOR < off < MAX_FACTOR_BY_SCALE:
        scale = now.gain ** (1 / ATTENUATION_BY_SCALE)  # larger shadows and larger line integrals at once
        match = given.match(orientation, scale)
        if match.residual < MAX_RESIDUAL_OF_FACTOR and match.residual < SCALE_WITH_GAIN * now.residual:
            return scale, match
    return 1.0, now


def _scale_finding(given: _Comparison, scale: float, told: Match, best: Match) -> Iterable[Finding]:
    usual = 1 / MAX_ATTENUATION_FACTOR < told.gain < MAX_ATTENUATION_FACTOR
    clear = best.residual < CLEARLY_BETTER * told.residual or not usual
    size = "too large" if scale < 1 else "too small"
    amount = f"{abs(1 / scale - 1):.0%}" if 0.6 < scale < 1.7 else f"by a factor of {max(scale, 1 / scale):.2g}"
    fact = f"the voxels of the volume are {amount} {size}, or the distances of the radiographs are wrong"
    remedy = f"give volume.voxel_size = {scale * given.voxel_size:.4g}, or correct the geometry"
    yield given.finding(Level.ERROR if clear else Level.WARNING, fact, _evidence(told, best), remedy)


def _attenuation(given: _Comparison, match: Match, air: float) -> Iterable[Finding]:
    """Units of the attenuation."""
    factor = match.gain
    if air != 0:
        fact = "the volume holds grey values, not attenuation in 1/mm"
        evidence = f"air is at {air:.4g}, and a grey value is {factor:.3g} 1/mm"
        yield given.finding(Level.ERROR, fact, evidence, f"give (volume - {air:.6g}) * {factor:.4g}")
        return
    off = max(factor, 1 / factor) if factor > 0 else np.inf
    missing = match.residual**2 > MISSING_GRAINS * (1 - 1 / off)  # grains that are not there lower the factor too
    if off < NOTED_ATTENUATION_FACTOR or match.residual > MAX_RESIDUAL_OF_FACTOR or missing:
        return
    units = {0.1: "in 1/cm", 10.0: "in 1/cm times 100", 1000.0: "in 1/um", 0.001: "in 1/m, or grey values"}
    units |= {1 / given.voxel_size: "per voxel"}
    cause = next((u for f, u in units.items() if abs(factor / f - 1) < UNIT_TOLERANCE), "grey values or in other units")
    fact = f"the attenuation of the volume is {cause}, not in 1/mm"
    evidence = f"the radiographs attenuate {factor:.3g} times as much as its projection"
    level = Level.ERROR if off > MAX_ATTENUATION_FACTOR else Level.WARNING
    yield given.finding(level, fact, evidence, f"multiply the volume by {factor:.4g}")


def _place(given: _Comparison, match: Match) -> Iterable[Finding]:
    """Whether the volume lies where the radiographs have the sample."""
    voxels = match.shift / given.voxel_size
    if match.residual > MAX_RESIDUAL_OF_FACTOR:
        return
    if np.abs(voxels).max() < (MIN_SHIFT_VOXELS if given.same_state else NOTED_SHIFT_VOXELS):
        return
    text = ", ".join(f"{v:.1f}" for v in voxels)
    center = np.array(given.volume.center) + match.shift
    remedy = f"give volume.center = [{', '.join(f'{c:.4g}' for c in center)}]"
    if given.same_state:
        fact = "the volume does not lie where the radiographs have the sample"
        yield given.finding(Level.WARNING, fact, f"it is ({text}) voxels off (x, y, z)", remedy)
    else:
        fact = "the sample moved as a whole, or the volume is not centred on the rotation axis"
        remedy = f"reference.radiographs beside reference.volume would tell; if it did not move, {remedy}"
        yield given.finding(Level.NOTE, fact, f"by ({text}) voxels (x, y, z)", remedy)
