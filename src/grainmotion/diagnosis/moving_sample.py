"""Whether the sample moved while its full scan was taken: it crept, settled or jumped, or source and panel drifted.

Each radiograph is compared with its prediction from the half of the views to which it does not belong, which gives a
shift of every view (`reconstruction.view_shifts`).  Shifts that grow with time, or change at one view, are a motion of
the sample: in the direction of u the projections of one vector (x and y), in the direction of v one number (z).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.view_consistency import BinnedViews
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.view_shifts import ViewShifts
from grainmotion.reconstruction.view_shifts import view_shifts

MOTION_CHECK: Check = "moving-sample"
MIN_MOTION_PIXELS = 0.25
"""Motion over the whole scan from which it is told, pixels at the sample.

A creep of 0.5 voxel made errors twice as large as at rest.  Twelve hard cases and seven laboratory cases at rest gave
0.0-0.28, never significant."""
HARMFUL_MOTION_PIXELS = 2.0
"""The same, from which the scan cannot be used as it is: errors of 0.07 to 0.1 voxel, three to five standard
deviations, at 2 pixels."""
SIGNIFICANT_MOTION = 8.0
"""Standard deviations from which a motion is told: samples at rest gave up to 6, motions of a voxel 10 to 70."""
MAX_SD_PIXELS = 0.8
"""Standard deviation up to which a component is judged: half a turn about an axis that is off hardly determines it."""
MAX_MISFIT_SHARE = 0.7
"""Largest misfit of the shifts with a motion over that without: 0.83 at least at rest, 0.1-0.3 for a voxel."""
MIN_VIEWS_BESIDE_A_JUMP = 3
"""Views before and after a jump."""
CLEARLY_ONE_KIND = 0.8
"""Misfit of one kind of motion over that of another, from which only the first is named."""

MotionKind = Literal["steady", "jump", "panel"]


@dataclass(frozen=True, eq=False)
class FittedMotion:
    """A motion that explains the shifts of views.

    Attributes
    ----------
    kind : {"steady", "jump", "panel"}
    amounts, sd : array
        Over the whole scan, along x, y and z, or for "panel" along u and v; pixels at the sample.
    misfit, at_rest : float
        Root mean square of what remains of the shifts, and of the shifts without a motion.
    view : int
        The first view after a jump.
    """

    kind: MotionKind
    amounts: Float
    sd: Float
    misfit: float
    at_rest: float
    view: int = 0

    @property
    def significant(self) -> bool:
        """Whether some component is large and certain, and explains most of the shifts."""
        certain = (np.abs(self.amounts) > SIGNIFICANT_MOTION * self.sd) & (self.sd < MAX_SD_PIXELS)
        large = np.abs(self.amounts) > MIN_MOTION_PIXELS
        return bool((certain & large).any()) and self.misfit < MAX_MISFIT_SHARE * self.at_rest

    @property
    def size(self) -> float:
        """Length of the motion, pixels at the sample."""
        return float(np.linalg.norm(self.amounts))


def moving_sample_findings(
    views: BinnedViews, geometry: Geometry, residual: Float, *, where: str
) -> tuple[Finding, ...]:
    """A finding if the sample moved during a full scan.

    Parameters
    ----------
    views : BinnedViews
        Radiographs, binned.
    geometry : Geometry
        Of these.
    residual : (n, rows, columns) array
        Of half of the views against the other half, each pixel.
    where : str
        The scan.
    """
    small = replace(views.scan, geometry=geometry)
    return motion_findings(view_shifts(small, residual, views.factor, views.views, views.grid.center), where)


def motion_findings(shifts: ViewShifts, where: str) -> tuple[Finding, ...]:
    """A finding if the shifts of a full scan's views show that the sample moved during the scan."""
    likely = likely_motions(shifts)
    if not likely:
        return ()
    best = likely[0]
    level = Level.ERROR if best.size > HARMFUL_MOTION_PIXELS else Level.WARNING
    fact = "the sample did not stay in its place during the scan: " + ", or ".join(_words(m) for m in likely)
    evidence = _evidence(best, shifts.pixel)
    first = f"; the views before or from {best.view} on agree among themselves" if best.kind == "jump" else ""
    remedy = "let the sample settle and warm up, fix it to the stage, and take the scan again" + first
    remedy += "; if the file records the stage's motors, or the motion is known, give it in a table of views (geometry)"
    return (Finding(level, MOTION_CHECK, where, fact, evidence, remedy),)


def likely_motions(shifts: ViewShifts) -> list[FittedMotion]:
    """Motions that explain the shifts of a full scan's views, the likeliest first; none if the sample was at rest."""
    if len(shifts.times) < 4 * MIN_VIEWS_BESIDE_A_JUMP:
        return []
    candidates = steady_motion(shifts), panel_motion(shifts), jump_motion(shifts)
    least = min(motion.misfit for motion in candidates)
    likely = [motion for motion in candidates if least > CLEARLY_ONE_KIND * motion.misfit]
    if not likely:  # no shift was measured: the reconstruction is empty, as of line integrals below zero
        return []
    best = min(likely, key=lambda motion: round(motion.misfit / max(least, 1e-12), 1))
    likely.sort(key=lambda motion: motion is not best)
    return likely if best.significant else []


def displaced_volume(shifts: ViewShifts, motion: FittedMotion) -> Float:
    """Where the volume of a sample that moved lies beside its mean place during the scan, ``(2,)``, x and y in pixels.

    A reconstruction puts it where the views agree best, and each sees only what is along its u: a creep along x by a
    pixel in one turn moves the volume by 1/4π pixel along y.
    """
    profile = shifts.times if motion.kind != "jump" else np.where(shifts.views < motion.view, -0.5, 0.5)
    along_u = profile * (motion.amounts[0] if motion.kind == "panel" else shifts.along @ motion.amounts[:2])
    place = np.linalg.lstsq(shifts.along, along_u, rcond=None)[0]
    return place if motion.kind == "panel" else place - motion.amounts[:2] * profile.mean()


def steady_motion(shifts: ViewShifts) -> FittedMotion:
    """The motion of the sample at constant velocity that explains the shifts best."""
    return _motion(shifts, "steady", shifts.times)


def jump_motion(shifts: ViewShifts) -> FittedMotion:
    """The motion of the sample at one moment that explains the shifts best."""
    n, m = len(shifts.times), MIN_VIEWS_BESIDE_A_JUMP
    jumps = (_motion(shifts, "jump", np.where(np.arange(n) < k, -0.5, 0.5), k) for k in range(m, n - m + 1))
    return min(jumps, key=lambda motion: motion.misfit)


def panel_motion(shifts: ViewShifts) -> FittedMotion:
    """The motion of source and panel at constant velocity that explains the shifts best."""
    return _fitted(shifts, "panel", shifts.times[:, None], shifts.times)


def _motion(shifts: ViewShifts, kind: MotionKind, profile: Float, place: int = 0) -> FittedMotion:
    return _fitted(shifts, kind, profile[:, None] * shifts.along, profile, int(shifts.views[place]))


def _fitted(shifts: ViewShifts, kind: MotionKind, across: Float, upright: Float, view: int = 0) -> FittedMotion:
    """Least squares of both shifts; a panel that is off, and a sample that is off its place, are allowed for."""
    one = np.ones_like(upright)
    amounts, sds, squares = [], [], np.zeros(2)
    for values, moving, still in (
        (shifts.values[:, 0], across, np.column_stack([one, shifts.along])),
        (shifts.values[:, 1], upright[:, None], one[:, None]),
    ):
        columns, number = np.hstack([moving, still]), moving.shape[1]
        inverse = np.linalg.pinv(columns)
        x = inverse @ values
        rests = values - columns @ x, values - still @ np.linalg.lstsq(still, values, rcond=None)[0]
        squares += [rest @ rest for rest in rests]
        variance = float(rests[0] @ rests[0]) / max(len(values) - columns.shape[1], 1)
        amounts.append(x[:number])
        sds.append(np.sqrt(variance * (inverse[:number] ** 2).sum(axis=1)))
    misfit, at_rest = np.sqrt(squares / len(one))
    return FittedMotion(kind, np.concatenate(amounts), np.concatenate(sds), float(misfit), float(at_rest), view)


def _words(motion: FittedMotion) -> str:
    """What happened."""
    return {
        "steady": "it moved steadily (crept, settled, or dried)",
        "jump": f"it jumped before view {motion.view} (from 0)",
        "panel": "source, panel or stage drifted",
    }[motion.kind]


def _evidence(motion: FittedMotion, pixel: float) -> str:
    names = ("u", "v") if motion.kind == "panel" else ("x", "y", "z")
    amounts = ", ".join(f"{a:+.2f}" for a in motion.amounts)
    sd = float(motion.sd.max())
    return f"({amounts}) pixels along {', '.join(names)}, ± {sd:.2f}; {motion.size * pixel:.3g} mm at the sample"
