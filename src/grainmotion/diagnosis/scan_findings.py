"""What is said of a full scan whose views contradict each other, or may be mirrored."""

from __future__ import annotations

from dataclasses import replace

from grainmotion.diagnosis.hypotheses import HYPOTHESES
from grainmotion.diagnosis.misfit_pattern import misfit_pattern
from grainmotion.diagnosis.rival_geometries import Comparison, Rivals, Tried
from grainmotion.diagnosis.settings import CheckSettings
from grainmotion.model.finding import Check, Finding, Level

CHECK: Check = "reference-geometry"
SENSE: Check = "sense-of-rotation"
SENSE_FIX = "angles-negated"
MAX_VOXEL_RATIO = 1.5
"""Voxels over pixels at the sample from which they are named where the views contradict each other: twice as large, a
sound scan left 0.14."""
TWINS = {
    "transposed": ("quarter-turned", "quarter-turned-back"),
    "quarter-turned": ("transposed", "quarter-turned-back"),
    "quarter-turned-back": ("transposed", "quarter-turned"),
}
"""Hypotheses that are mirror images of each other, which rough trials do not tell apart."""
HOW_TO_TELL = (
    "look at the first radiographs: seen from behind the sample, z up, a grain that is right of the centre at angle 0 "
    "(at +x) must come nearer to the source as the angle grows"
)
MIRRORED = (
    "the sample is mirrored: either the stage turns the other way than the angles say (the angles have the wrong "
    "sign, or the radiographs are in reverse order), or the columns of the radiographs run the other way (images "
    "flipped left to right)"
)
TO_UNMIRROR = (
    "the scan alone does not tell which: if the images are as the camera sees them from behind the sample, give the "
    "angles with the other sign (fix angles-negated), else flip the images (fix columns-flipped); the same for the "
    "states that have the same mistake, and for no other; " + HOW_TO_TELL
)
CAUSES = (
    "check the angles (unit, sense, span, end point), the order and number of the radiographs, first_row, distances, "
    "flats and darks; saturated or stuck pixels and scatter do it, too"
)


def beside_the_volume(share: float, where: str) -> Finding:
    """A finding on a volume that does not hold the sample: its views contradict each other in any geometry."""
    fact = "the volume is smaller than the sample, as the distances and the pixel size have it: what lies beside it is "
    fact += "not modelled, and its views contradict each other"
    evidence = f"{share:.0%} of the line integrals lie on rays that pass the volume by"
    remedy = "give a larger volume.shape, or correct volume.voxel_size, pixel_size or the distances"
    return Finding(Level.ERROR, CHECK, where, fact, evidence, remedy)


def explained(nominal: Tried, best: Tried, where: str) -> Finding:
    evidence = (
        f"residual of half of the views against the other half {nominal.consistency.residual:.3f} as given, "
        f"{best.consistency.residual:.3f} then; {nominal.consistency.attainable:.3f} is due to the number of views"
    )
    finding = named(Level.ERROR, where, best.fixes, evidence)
    twins = TWINS.get(best.fixes[-1], ())
    if not twins:
        return finding
    hint = f"the scan alone does not tell it from its mirror images ({', '.join(twins)}): {HOW_TO_TELL}"
    return replace(finding, remedy=f"{finding.remedy}; {hint}")


def named(level: Level, where: str, fixes: tuple[str, ...], evidence: str) -> Finding:
    """The finding that names a mistake, or several."""
    if fixes == (SENSE_FIX,):
        return Finding(level, SENSE, where, MIRRORED, evidence, TO_UNMIRROR, SENSE_FIX)
    causes = [HYPOTHESES[name] for name in fixes]
    fact = "the views contradict each other: probably " + ", and ".join(c.mistake for c in causes)
    return Finding(level, CHECK, where, fact, evidence, "; ".join(c.remedy for c in causes), ", ".join(fixes))


def unexplained(rivals: Rivals, nominal: Tried, settings: CheckSettings, where: str, voxel_size: float) -> Finding:
    consistency = nominal.consistency
    level = Level.ERROR if consistency.judged > settings.stop else Level.WARNING
    evidence = (
        f"half of the views against the other half leaves {consistency.judged:.3f}; sound scans leave 0.02-0.08; "
        f"{misfit_pattern(consistency, rivals.views)}"
    )
    ratio = voxel_size / nominal.geometry.pixel_at((0.0, 0.0, 0.0))
    if ratio > MAX_VOXEL_RATIO:
        fact = (
            f"the voxels are {ratio:.1f} times as large as a pixel at the sample, too large to simulate its edges, or "
        )
        fact += "the views contradict each other"
        return Finding(level, CHECK, where, fact, evidence, f"give a volume.voxel_size of about a pixel; else {CAUSES}")
    return Finding(level, CHECK, where, "the views contradict each other", evidence, CAUSES)


def sense_unknown(comparison: Comparison, where: str) -> Finding:
    first, second = comparison.residuals
    fact = (
        "the scan does not tell the sense of rotation: with the angles of the other sign, which mirrors the sample, it "
        "fits as well"
    )
    return Finding(Level.NOTE, SENSE, where, fact, f"residuals {first:.4f} and {second:.4f}", HOW_TO_TELL)
