"""Check of a full scan: whether its views agree with each other in the given geometry, and if not, why.

The usual mistakes are those of `grainmotion.diagnosis.hypotheses`.  The sense of rotation and the end point are tested
on every scan, because they leave the residual low.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from grainmotion._arguments import checked_arguments
from grainmotion.calibration.calibrate import MIN_CALIBRATION_VIEWS
from grainmotion.diagnosis.coarse_projection import CoarseScan
from grainmotion.diagnosis.coinciding_views import coinciding_findings
from grainmotion.diagnosis.common_level import common_level_findings
from grainmotion.diagnosis.directions import missing_directions
from grainmotion.diagnosis.fan_angle import fan_findings
from grainmotion.diagnosis.hypotheses import EQUAL_STEPS, HYPOTHESES, corrected, has_equal_steps
from grainmotion.diagnosis.misfit_pattern import outlying_views
from grainmotion.diagnosis.moving_sample import moving_sample_findings
from grainmotion.diagnosis.rival_geometries import Comparison, Rivals, Tried, singles
from grainmotion.diagnosis.scan_findings import (
    CHECK,
    SENSE,
    SENSE_FIX,
    TWINS,
    beside_the_volume,
    explained,
    named,
    sense_unknown,
    unexplained,
)
from grainmotion.diagnosis.settings import CheckSettings
from grainmotion.model.finding import Finding, Level
from grainmotion.model.progress import detail
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume

ALWAYS_TESTED = (SENSE_FIX, "end-point-counted", "end-point-left-out")
"""Mistakes that leave the residual below ``[check] warn``; each is compared at the finest pixels."""
MIN_COLUMNS = 12
"""A narrower panel is not judged."""
SHIFT_SEARCHED_FROM = 0.5
"""Share of ``[check] warn`` from which the panel's shift is searched before anything is said."""
EXPLAINS_SHARE = 0.6
"""A hypothesis explains a bad scan if it leaves less than this share of the judged residual."""
ERROR_SHARE = 0.98
"""Of the residual, at the finest pixels: a rival that leaves less, significantly, makes the given geometry an error.

With the mistake undone scans kept 0.38-0.97 (SNR 10-50, 24-120 views); between it and 1 only a warning is given.
"""
MAX_ODD_VIEWS = 2
"""So few views that fit much worse than all others are at fault themselves, not the geometry."""
MAX_SHARE_OUTSIDE = 0.1
"""Share of the line integrals beside the volume, from which it is too small: as for a given volume."""
CANDIDATES = 2
"""So many hypotheses, the best of the rough trials, are judged; the very best is also tried with each other one."""
MIRROR_FIXES = (("columns-flipped",), ("half-turned",), ("order-reversed",))
"""Mirror images that fit as well as angles negated, and are told together with it."""
ROW_AIR_QUANTILE = 0.02
"""Of the line integrals of a row over all views, what counts as air."""
AS_GOOD = 0.01
"""Judged residuals that differ by less are equal."""


@checked_arguments
def check_scan(
    scan: Scan, grid: Volume, settings: CheckSettings | None = None, *, where: str = "reference"
) -> tuple[Finding, ...]:
    """Check a full scan: whether its views agree with each other in its geometry.

    Parameters
    ----------
    scan : Scan
        Line integrals of a full scan, with the geometry as given.
    grid : Volume
        Where the sample is; its values do not matter.
    settings : CheckSettings, optional
        Residuals from which to warn and to stop.
    where : str
        What the findings name as their place.

    Returns
    -------
    tuple of Finding
        Empty for a sound scan whose sense of rotation the data confirm, or for one of too few views to be judged
        (12).  ``fix`` names a hypothesis of `grainmotion.diagnosis.hypotheses`.

    Examples
    --------
    >>> gm.check_scan(case.reference(), case.scanner.grid)  # nothing is wrong
    ()
    """
    with threadpool_limits(limits=1, user_api="blas"):  # matrices are small: threads would wait for each other
        found = _contradictions(scan, grid, settings or CheckSettings(), where)
    if len(scan) < MIN_CALIBRATION_VIEWS or any(finding.level is Level.ERROR for finding in found):
        return found
    return (*found, *missing_directions(scan.geometry, where))


def _contradictions(scan: Scan, grid: Volume, settings: CheckSettings, where: str) -> tuple[Finding, ...]:
    """What the views tell about the geometry by contradicting each other."""
    ends = coinciding_findings(scan, where=where)
    if ends:
        return ends
    if len(scan) < MIN_CALIBRATION_VIEWS or scan.geometry.shape[1] < MIN_COLUMNS or not scan.line_integrals.any():
        return ()
    share = CoarseScan.of(scan, grid.center).share_outside(grid)
    if share > MAX_SHARE_OUTSIDE:
        return (beside_the_volume(share, where),)
    detail("views against each other", 0, 3)
    rivals = Rivals(scan, grid)
    negligible = SHIFT_SEARCHED_FROM * settings.warn
    nominal = rivals.as_given(settings.warn)
    is_sound = nominal.consistency.judged <= settings.warn
    if is_sound and all(c.first_is_better for c in _compared(rivals, nominal).values()):
        return _moving_sample(rivals, nominal, where) or _wrong_angle_of_rays(scan, grid, nominal, where)
    if negligible < nominal.consistency.residual <= settings.warn:
        nominal = rivals.as_given(negligible)
    if nominal.consistency.judged > negligible:
        searched = rivals.tried((), negligible)
        nominal = min(nominal, searched, key=lambda tried: tried.consistency.judged)
    if nominal.consistency.judged <= settings.warn:
        close = _close_rivals(rivals, nominal, where)
        if any(f.check == SENSE and f.level is not Level.NOTE for f in close):
            return close
        found = close or _moving_sample(rivals, nominal, where)
        return (*found, *_wrong_angle_of_rays(scan, grid, nominal, where))
    known = _sinogram_order(scan, grid, nominal, where) or common_level_findings(scan, grid, nominal, settings, where)
    if known:
        return known
    explanation = _explanation(rivals, nominal, settings)
    if explanation is not None:
        return (explained(nominal, explanation, where),)
    if not 0 < len(outlying_views(nominal.consistency)) <= MAX_ODD_VIEWS:
        close = _close_rivals(rivals, nominal, where)
        if any(finding.fix and finding.level is Level.ERROR for finding in close):
            return close
    fan = _wrong_angle_of_rays(scan, grid, nominal, where, settings.warn)
    return (
        tuple(replace(f, level=Level.ERROR) for f in fan)
        or _moving_sample(rivals, nominal, where)
        or (unexplained(rivals, nominal, settings, where, grid.voxel_size),)
    )


def _sinogram_order(scan: Scan, grid: Volume, nominal: Tried, where: str) -> tuple[Finding, ...]:
    """A finding if the stack holds one image a row of the panel instead of one a view; no geometry undoes that."""
    if len(scan) != scan.geometry.shape[0]:
        return ()
    valid = None if scan.valid is None else scan.valid.swapaxes(0, 1)
    images = scan.line_integrals.swapaxes(0, 1)
    air = np.quantile(images, ROW_AIR_QUANTILE, axis=(0, 2), keepdims=True)  # levels were taken off rows for views
    images = images - air
    exchanged = replace(scan, line_integrals=images.astype(scan.line_integrals.dtype), valid=valid)
    residual = Rivals(exchanged, grid).tried(()).consistency.judged
    if residual > EXPLAINS_SHARE * nominal.consistency.judged:
        return ()
    fact = "the stack is in the order of sinograms: its images are rows of the panel, not radiographs"
    evidence = f"half of the views against the other half leaves {nominal.consistency.judged:.3f} as given, "
    evidence += f"{residual:.3f} with views and rows exchanged"
    return (Finding(Level.ERROR, CHECK, where, fact, evidence, "exchange the first two axes of the stack"),)


def _compared(rivals: Rivals, nominal: Tried) -> dict[str, Comparison]:
    """The nominal geometry beside those without a mistake that leaves the residual low."""
    detail("sense of rotation and end point", 1, 3)
    names = ALWAYS_TESTED if has_equal_steps(nominal.geometry) else (*ALWAYS_TESTED, EQUAL_STEPS)
    others = {name: corrected(nominal.geometry, [name]) for name in names}
    rivals.compare_first_halves(nominal, list(others.values()))
    return {name: rivals.compare(nominal, geometry) for name, geometry in others.items()}


def _moving_sample(rivals: Rivals, nominal: Tried, where: str) -> tuple[Finding, ...]:
    """A finding if the sample moved during the scan; with less than half a turn nothing tells it from its shape."""
    if missing_directions(nominal.geometry, where):
        return ()
    detail("motion of the sample", 2, 3)
    views = rivals.judged_views
    geometry = views.geometry(nominal.geometry, nominal.shift / views.factor)
    return moving_sample_findings(views, geometry, nominal.consistency.residuals, where=where)


def _wrong_angle_of_rays(
    scan: Scan, grid: Volume, nominal: Tried, where: str, most: float = np.inf
) -> tuple[Finding, ...]:
    """A finding if the rays spread over another angle; where directions are missing, that is not to be known."""
    if missing_directions(nominal.geometry, where):
        return ()
    return fan_findings(scan, grid, nominal, where, most)


def _close_rivals(rivals: Rivals, nominal: Tried, where: str) -> tuple[Finding, ...]:
    """Findings about mistakes that leave the residual low."""
    compared = _compared(rivals, nominal)
    better = {name: c for name, c in compared.items() if c.second_is_better}
    if better:
        name = min(better, key=lambda k: better[k].residuals[1])
        first, second = better[name].residuals
        level = Level.ERROR if second < ERROR_SHARE * first else Level.WARNING
        return (named(level, where, (name,), f"residual of half of the views against the other half {first:.3f} as "
                       f"given, {second:.3f} then, {-better[name].t:.0f} standard errors"),)  # fmt: skip
    sense = compared[SENSE_FIX]
    if sense.undecided:
        return (sense_unknown(sense, where),)
    return ()


def _explanation(rivals: Rivals, nominal: Tried, settings: CheckSettings) -> Tried | None:
    """The best of the hypotheses, one or two together, if it is clearly better than the nominal geometry."""
    detail("possible mistakes of the geometry", 1, 3)
    limit = EXPLAINS_SHARE * nominal.consistency.judged
    ranking = rivals.ranked(singles())
    best = _best(rivals, ranking[:CANDIDATES])
    if best.consistency.judged > min(limit, settings.warn):
        pairs = [(*best.fixes, other) for other in HYPOTHESES if other not in best.fixes]
        pair = _best(rivals, rivals.ranked(pairs)[:CANDIDATES])
        if pair.consistency.judged < EXPLAINS_SHARE * best.consistency.judged:
            best = pair
    if best.consistency.judged > limit:
        return None
    if best.fixes in MIRROR_FIXES:
        mirrored = rivals.tried((SENSE_FIX,))
        if mirrored.consistency.judged < best.consistency.judged + AS_GOOD:
            return mirrored
    return _refined(rivals, best)


def _best(rivals: Rivals, candidates: list[tuple[str, ...]]) -> Tried:
    return min((rivals.tried(fixes) for fixes in candidates), key=lambda tried: tried.consistency.residual)


def _refined(rivals: Rivals, best: Tried) -> Tried:
    """The explanation beside those that rough trials cannot tell from it: its mirror image, and similar spans."""
    *first, last = best.fixes
    others = [(*first, twin) for twin in TWINS.get(last, ())]
    for fixes in others or [(*best.fixes, SENSE_FIX)]:
        if len(set(fixes)) == len(fixes):
            geometry = corrected(rivals.nominal, fixes)
            if rivals.compare(best, geometry).second_is_better:
                best = replace(best, fixes=fixes, geometry=geometry)
    return best
