"""What the motions of a state show: notes of the fit, its gain, and one common cause where nearly all grains fail."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.grain_scale import SCALE_CHECK, SCALE_NOTE
from grainmotion.diagnosis.state_residual import RESIDUAL_NOTE
from grainmotion.diagnosis.state_views import STATE_CHECK
from grainmotion.model.finding import Check, Finding, Level, worst_first
from grainmotion.model.motions import Motions, Status

MIN_COMMON_GRAINS, MIN_COMMON_SHARE = 4, 0.8
"""Grains of a state, and the share of them that must fail, for one common cause.

With a wrong geometry or scale all of 5 to 20 grains fail (17 cases of wrong input), in the hard cases at most half (one
broken grain of 6, 2 views); a sample mirrored in both scans loses 15 of 20, which is told as a warning."""
USUAL_GAINS = (0.9, 1.1)
"""Fitted gains without a remark: 0.976 to 1.007 in the good and the 12 hard cases, 0.96 with voxels 2 % too large."""
MAX_GRAINS_DISTURBED = 16
"""Grains up to which one that is not as in the reference may disturb all others (the cases ``broken``, 6 grains)."""
PLAUSIBLE_GAINS = (0.6, 1.6)
"""Fitted gains of grains in wrong places, 0.67 to 1.49 in trials; beyond them the line integrals have another scale
(0.29 and less, 9.8)."""
SEE_COMMON_CAUSE = "see the common cause"
"""Beginning of the reason of a grain that failed together with nearly all others."""

_GEOMETRY = (
    "the radiographs do not show this sample as its geometry says. Usual causes: angles with the wrong sign, unit or "
    "start; radiographs in another order, or flipped, or one of another state among them; wrong distances or voxel "
    "size; another sample; a poor reference, or a volume or labels that are flipped or shifted; motions far beyond a "
    "grain's diameter"
)
_DISTURBED = f"a grain that is broken, missing or new disturbs all others of so small a sample, or {_GEOMETRY}"
_SCALE = (
    "the line integrals of the radiographs and of the volume differ in scale. Usual causes: another kind (counts, "
    "transmission, line-integrals) or the wrong flats; a given volume of grey values instead of 1/mm; a wrong unit of "
    "length; another sample"
)
_PANEL = (
    "the panel does not see them where the geometry puts them. Usual causes: detector_offset, distances or pixel_size "
    "of this state; a sample that was lifted or taken out"
)
_STRAINED = "; strained grains look so as well, which most of these are: set [track] strain = true first"


@dataclass(frozen=True)
class _Kind:
    """How notes that begin alike are told: level, name of the check, and what to do where the note does not say it."""

    beginning: str
    level: Level
    check: Check
    remedy: str = ""


_KINDS = (
    _Kind("the views contradict each other", Level.WARNING, "views"),
    _Kind(SCALE_NOTE, Level.WARNING, SCALE_CHECK),
    _Kind(RESIDUAL_NOTE, Level.WARNING, "fit", "compare panel and exposure of this state with those of the reference"),
    _Kind(
        "something that is no grain attenuates", Level.WARNING, "new-grain",
        "look at residuals.tif; lower segment.threshold if a grain of the reference has no label",
    ),
)  # fmt: skip
"""Notes that are warnings; all others are notes, and so are views that contradict each other but are too few to be
corrected: with 2 views beam hardening looks alike (the case ``beam-hardening``), and where views are really out of
place the grains are poorly determined, which is a warning of its own."""


def check_motions(name: str, motions: Motions, known: tuple[Finding, ...] = ()) -> tuple[Finding, ...]:
    """What the motions of the state ``name`` show; ``known`` was found about it before it was tracked."""
    where = f"states.{name}"
    common = common_cause(motions, where, known)
    if common is not None:
        return (common,) if common not in known else ()
    return (
        *_new_grains(motions, where),
        *_note_findings(motions, where),
        *_gain_findings(motions, where),
        *_many(motions, where),
    )


def common_cause(motions: Motions, where: str = "state", known: tuple[Finding, ...] = ()) -> Finding | None:
    """The cause that all or nearly all grains failed; None if they did not.

    It is the worst of what is ``known`` about the state, if that is an error, has a fix or is about its geometry; else
    the usual causes of what the fit looks like.
    """
    failed = failures(motions)
    if len(failed) < MIN_COMMON_GRAINS or failed.mean() < MIN_COMMON_SHARE:
        return None
    blamed = worst_first([f for f in known if f.level is Level.ERROR or f.fix or f.check == STATE_CHECK])
    if blamed:
        return blamed[0]
    count = f"{failed.sum()} of {len(failed)} grains fail"
    level = Level.WARNING if motions.usable.any() else Level.ERROR
    gain, reasons = motions.fit.gain, {r for r, f in zip(motions.reasons, failed, strict=True) if f}
    lost = np.isin(motions.statuses, [Status.LEFT_FIELD.value, Status.NOT_FITTED.value])
    numbers = f"gain {gain:.3g}"
    if motions.fit.costs:
        numbers += f", relative residual {motions.fit.costs[-1][1]:.2g}; about 1 and below 0.1 where all fits"
    remedy = f"check radiographs, kind and geometry of {where}, and the reference"
    if len(reasons) == 1 and not (told := reasons.pop()).startswith(SEE_COMMON_CAUSE):
        return Finding(level, "common-cause", where, f"{count}, all for one reason: {told}", numbers, remedy)
    if not PLAUSIBLE_GAINS[0] < gain < PLAUSIBLE_GAINS[1]:
        cause = _SCALE
    else:
        cause = _PANEL if lost.mean() > 0.5 else _wrong_places(motions)
    fact = f"{count}, so they have one cause: {cause}"
    return Finding(level, "common-cause", where, fact, numbers, remedy)


def _wrong_places(motions: Motions) -> str:
    """Why grains are not where they are looked for; whether the geometry fits was tried before they were tracked."""
    return _DISTURBED if len(motions) <= MAX_GRAINS_DISTURBED else _GEOMETRY


def with_common_cause(motions: Motions, cause: Finding | None) -> Motions:
    """The motions with the common cause as the reason of all grains that failed, instead of blaming each."""
    if cause is None:
        return motions
    sentence = f"{SEE_COMMON_CAUSE}: {cause.fact}; {cause.remedy or 'take a look at the radiographs'}"
    failed = failures(motions)
    reasons = (sentence if f else reason for f, reason in zip(failed, motions.reasons, strict=True))
    return replace(motions, reasons=tuple(reasons))


def failures(motions: Motions) -> NDArray[np.bool_]:
    """Grains that were not found, ``(n,)``: not those that fit in several ways, are absent, broken, or seen in part."""
    found = (Status.AMBIGUOUS.value, Status.ABSENT.value, Status.CUT.value, Status.BROKEN.value)
    return ~(motions.usable | np.isin(motions.statuses, found))


def _note_findings(motions: Motions, where: str) -> list[Finding]:
    """A finding for each note of the fit; for several places of unexplained attenuation one."""
    found: list[Finding] = []
    notes = dict.fromkeys(motions.fit.notes)
    strained = 2 * np.count_nonzero(motions.statuses == Status.DEFORMED.value) > len(motions)
    for kind in _KINDS:
        alike = [note for note in notes if note.startswith(kind.beginning)]
        if alike:
            more = f"; {len(alike) - 1} more such places" if len(alike) > 1 else ""
            level = kind.level
            if kind.check == "views" and motions.fit.view_corrections is None:
                level = Level.NOTE
            if kind.check == "views" and strained:
                more += _STRAINED
            found.append(Finding(level, kind.check, where, alike[0] + more, remedy=kind.remedy))
    known = tuple(kind.beginning for kind in _KINDS)
    return found + [Finding(Level.NOTE, "fit", where, note) for note in notes if not note.startswith(known)]


def _new_grains(motions: Motions, where: str) -> list[Finding]:
    """A finding if grains have appeared."""
    count = len(motions.fit.appeared)
    if not count:
        return []
    fact = f"{count} grain{'s' * (count != 1)} of this state {'is' if count == 1 else 'are'} not in the reference"
    if (motions.statuses == Status.ABSENT.value).any():
        fact += ", or moved there from far away, as others are absent"
    evidence = "ellipsoids stand for them so that they disturb no other; appeared.csv holds places and sizes"
    remedy = "check the reference for them; lower segment.threshold if one has no label"
    return [Finding(Level.WARNING, "new-grain", where, fact, evidence, remedy)]


def _gain_findings(motions: Motions, where: str) -> list[Finding]:
    gain = motions.fit.gain
    if USUAL_GAINS[0] < gain < USUAL_GAINS[1] or not motions.usable.any():
        return []
    fact = "the radiographs attenuate more or less than the grains as simulated: another voltage or filter, a wrong "
    fact += "unit or voxel size of a given volume, beam hardening, or missing or new grains"
    return [Finding(Level.WARNING, "gain", where, fact, f"gain {gain:.3g}, about 1 is usual", "check these")]


def _many(motions: Motions, where: str) -> list[Finding]:
    """Findings if most grains fail, or if the views do not determine a translation of nearly all."""
    failed, n, found = failures(motions), len(motions), list[Finding]()
    if n >= MIN_COMMON_GRAINS and failed.mean() > 0.5:
        fact = f"{failed.sum()} of {n} grains fail, more than is likely by their own fault; if they are whole, "
        fact += _wrong_places(motions)
        remedy = f"look at residuals.tif of this state; check radiographs and geometry of {where}"
        found.append(Finding(Level.WARNING, "common-cause", where, fact, f"gain {motions.fit.gain:.3g}", remedy))
    poor = (motions.statuses == Status.POORLY_DETERMINED.value) & ~motions.ok_translation
    if n >= MIN_COMMON_GRAINS and poor.mean() >= MIN_COMMON_SHARE:
        fact = "the views do not determine a translation of nearly all grains: they are too few, look along nearly one "
        fact += "line, or contradict each other"
        count = f"{poor.sum()} of {n} grains are poorly determined"
        remedy = "take views 90 degrees apart, and check the geometry"
        found.append(Finding(Level.WARNING, "views", where, fact, count, remedy))
    return found
