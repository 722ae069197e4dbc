"""Few grains of a large sample that fit badly: what became of them, for little more than all others take.

In a small sample that is found by trials, each of which fits all grains anew.  In a large one

1. grains that the radiographs support less than any around them are left out, all at once, and those around them are
   solved for anew from the smooth field.  What had made up for an absent grain then leaves it: nothing of its shadow is
   left over.  Grains whose shadow is left over come back.
2. What still fits badly is judged in parts, windows of the radiographs around the worst grains, each by the trials of a
   small sample (`trials`): first for new grains, then by searching and cutting.

Both are done again while they explain anything (decision 0064).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.state_fit import PieceMotion
from grainmotion.projection.grain_arrays import planar
from grainmotion.tracking.attempt import Approach, Attempt, Job, approach, finish
from grainmotion.tracking.crowd_fit import CrowdFit, some
from grainmotion.tracking.ellipsoids import Ellipsoid, ellipsoid_images
from grainmotion.tracking.ellipsoids_beside import new_grains
from grainmotion.tracking.few_grains import NEIGHBOUR_DIAMETERS
from grainmotion.tracking.missing_grains import MISSING_REASON, grain_supports, registered
from grainmotion.tracking.parts_of_crowds import Part, Whole
from grainmotion.tracking.trials import EXPLAINED, Trial, best_trial, quick_trial

MAX_BAD_SHARE = 0.9
"""Share of badly fitting grains up to which a large sample is judged so; one absent grain of 300 disturbs 50."""
MAX_CROWD_ROUNDS, MAX_PARTS, MAX_FULL_PARTS = 6, 12, 6
"""Times that what fits badly is judged anew, parts each time, and parts in all in which grains are sought and cut as
well, as that takes some 10 s each, at most."""
MAX_SUSPECT_SUPPORT, MAX_SUSPECT_AMPLITUDE, MAX_ABSENT_AMPLITUDE = 0.9, 0.2, 0.05
"""Support (see `missing_grains`) up to which a grain may be absent; amplitude of what is left over up to which it is
left out until the next round, and in the end.  Of 1,000 stones six were left out at once: 0.00 to 0.08 for those that
were absent, 0.2 to 0.3 for the others."""
MAX_SWAPPED, MAX_SWAPS, MAX_SWAPPED_COST = 3, 9, 0.99
"""Neighbours that are left out in trial in place of an absent grain, such trials in all, and the cost over that before
up to which they were right."""
MIN_NEW_SHARES, MAX_PROPOSED = 10.0, 4
"""Cost that the whole loses beside a new grain, over a grain's mean share of it, from which it is one; new grains that
are tried in a round."""
WORST_SHARE = 0.6
"""Misfit over that of the worst grain from which another one is judged in the same round: those that a grain disturbs
fit less badly than itself."""
PARTS_APART = 3.0
"""Grain diameters between the grains that are judged in a round, at least."""
EITHER_REASON = (
    "its shadow is not where its neighbours went, but grain {label} beside it fits badly, so either may be absent; "
    "check which, or give a nearer start"
)
COPIED = (
    "translations", "rotations", "covariances", "statuses", "residuals", "iterations", "ok_translation", "ok_rotation",
)  # fmt: skip
"""Columns of motions."""


def is_crowd(near: Approach) -> bool:
    """Whether few grains of a large, dry and rigid sample fit badly."""
    fit, settings, share = near.fit, near.fit.settings, float(near.misregistered.mean())
    if not (fit.many and settings.search and 0 < share <= MAX_BAD_SHARE):
        return False
    views = fit.target.scan
    return near.fluid is None and not settings.strain and len(views) > 1 and not planar(fit.grains, views.geometry)


def best_trial_of_crowd(job: Job, near: Approach) -> Trial:
    """The trial that explains most of a large sample of which few grains fit badly."""
    crowd = _Crowd(CrowdFit.of(job, near))
    for turn in range(MAX_CROWD_ROUNDS):
        absent = crowd.without_absent()
        parts = crowd.parts()
        found = crowd.judged(parts, turn, quickly=True) or crowd.judged(parts, turn, quickly=False)
        if not parts or not (absent or found):
            break
    return crowd.finished()


@dataclass
class _Crowd:
    """A large sample whose badly fitting grains are judged.

    ``told`` are the motions of parts in which broken grains are, by row of the sample; ``absent`` are rows of grains
    that seem to be absent, ``there`` of those that were left out and came back, ``tried`` of those in the middle of
    parts of which all trials were made.
    """

    crowd: CrowdFit
    told: dict[int, Motions] = field(default_factory=dict)
    pieces: list[PieceMotion] = field(default_factory=list)
    absent: set[int] = field(default_factory=set)
    there: set[int] = field(default_factory=set)
    tried: set[int] = field(default_factory=set)

    # ------------------------------------------------------------------ absent grains
    def without_absent(self) -> bool:
        """Whether other grains seem to be absent than before; they are left out, and those around them solved anew."""
        crowd, before = self.crowd, np.array(sorted(self.absent), dtype=np.int64)
        _, bad = crowd.misfits()
        suspects = self._suspects(bad)
        if not len(suspects):
            return False
        former, asked = (crowd.out, crowd.pose, crowd.problem), np.union1d(before, suspects)
        affected = crowd.around(bad)
        self._from_field(self._out(asked), affected, "without those that may be absent")
        gone = self._asked(asked, MAX_SUSPECT_AMPLITUDE)
        self.there |= set(asked) - set(gone)
        if not len(np.setdiff1d(gone, before)):
            crowd.leave_out(former[0])
            _, crowd.pose, crowd.problem = former
            return False
        if len(gone) < len(asked):
            self._from_field(self._out(gone), affected, "without absent grains")
        self.absent = set(gone.tolist())
        self._swap(np.setdiff1d(gone, before))
        crowd.changed = True
        return True

    def _out(self, absent: NDArray[np.int64]) -> NDArray[np.bool_]:
        """The grains ``(n,)`` to leave out if these are absent."""
        return np.isin(np.arange(len(self.crowd.out)), [*absent, *self.told])

    def _asked(self, rows: NDArray[np.int64], most: float) -> NDArray[np.int64]:
        """Those of some rows that are left out of which no more than so much is there; others are put in place."""
        crowd, expected = self.crowd, self.crowd.expected_pose(rows)
        gone = crowd.amplitudes(rows, expected) < most
        crowd.take(rows[~gone], some(expected, np.flatnonzero(~gone)))
        return rows[gone]

    def _swap(self, absent: NDArray[np.int64]) -> None:
        """Leave a neighbour out in place of an absent grain where that fits better: it may have gone to its place."""
        crowd, tries = self.crowd, 0
        for row in absent:
            _, bad = crowd.misfits()
            distances = np.linalg.norm(crowd.places - crowd.places[row], axis=1)
            beside = np.flatnonzero(bad & (distances < NEIGHBOUR_DIAMETERS * crowd.diameter))
            for other in beside[np.argsort(distances[beside], kind="stable")][:MAX_SWAPPED]:
                if (tries := tries + 1) > MAX_SWAPS:
                    return
                cost, out, pose, problem = crowd.problem.cost(crowd.own_pose), crowd.out, crowd.pose, crowd.problem
                swapped, both = out.copy(), np.isin(np.arange(len(out)), [row, other])
                swapped[row], swapped[other] = False, True
                self._from_field(swapped, crowd.around(both), "another one left out")
                if crowd.problem.cost(crowd.own_pose) < MAX_SWAPPED_COST * cost:
                    self.absent = self.absent - {int(row)} | {int(other)}
                    break
                crowd.leave_out(out)
                crowd.pose, crowd.problem = pose, problem

    def _suspects(self, bad: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Rows of grains that fit badly and are supported less than any around them."""
        crowd = self.crowd
        supports = np.full(len(bad), np.inf)
        supports[crowd.rows] = [one.share for one in grain_supports(crowd.problem, crowd.own_pose)]
        doubted = np.setdiff1d(np.flatnonzero(bad & (supports < MAX_SUSPECT_SUPPORT)), list(self.there))
        near = cKDTree(crowd.places).query_ball_point(crowd.places[doubted], NEIGHBOUR_DIAMETERS * crowd.diameter)
        return np.array(
            [k for k, around in zip(doubted, near, strict=True) if supports[k] <= supports[around].min()],
            dtype=np.int64,
        )

    def _from_field(self, out: NDArray[np.bool_], affected: NDArray[np.bool_], name: str) -> None:
        """Leave grains out and solve for the affected ones from the smooth field."""
        rows = np.flatnonzero(affected)
        self.crowd.take(rows, some(self.crowd.near.field_pose, rows))
        self.crowd.leave_out(out)
        self.crowd.solve(affected, name)

    # ------------------------------------------------------------------ parts
    def parts(self) -> list[Part]:
        """Parts around the grains that fit worst, far enough from each other."""
        crowd = self.crowd
        fits, bad = crowd.misfits()
        shares = np.full(len(bad), -np.inf)
        shares[crowd.rows] = np.nan_to_num(fits.shares, posinf=0.0)
        chosen = list[int]()
        for row in np.flatnonzero(bad)[np.argsort(-shares[bad], kind="stable")]:
            if len(chosen) == MAX_PARTS or (chosen and shares[row] < WORST_SHARE * shares[chosen[0]]):
                break
            if all(np.linalg.norm(crowd.places[row] - crowd.places[k]) > PARTS_APART * crowd.diameter for k in chosen):
                chosen.append(int(row))
        if not chosen:
            return []
        whole = Whole.at(crowd.job, crowd.problem, crowd.own_pose)
        middles = np.searchsorted(crowd.rows, chosen)
        return [whole.part(int(k), bad[crowd.rows], some(crowd.near.field_pose, crowd.rows)) for k in middles]

    def judged(self, parts: list[Part], turn: int, *, quickly: bool) -> bool:
        """Whether the trials of any part explain more than was known; what they show is kept.

        Those that go ``quickly`` know absent and new grains only.
        """
        crowd, rows, moved = self.crowd, self.crowd.rows, np.zeros(len(self.crowd.out), dtype=bool)
        fit, done, proposed = crowd.fit, crowd.fit.stages_done, list[Ellipsoid]()
        if not quickly:
            left = MAX_FULL_PARTS - len(self.tried)
            parts = [part for part in parts if int(rows[part.middle]) not in self.tried][:left]
        for k, part in enumerate(parts, start=1):
            name = f"grains that fit badly, round {turn + 1}, {k} of {len(parts)}"
            fit.report(name, done)
            job = replace(part.job, progress=lambda message, *_, name=name: fit.report(f"{name}: {message}", done))
            self.tried |= set() if quickly else {int(rows[part.middle])}
            with suppress(np.linalg.LinAlgError):  # ends one part, not the run
                near = approach(job)
                trial = quick_trial(job, near) if quickly else best_trial(job, near)
                if trial is not None and _explains(trial, part):
                    moved[rows[part.rows]] = True
                    self._keep(trial, part, rows[part.rows])
                elif trial is not None:
                    proposed += trial.attempt.new
        if not moved.any():
            return bool(proposed) and self._with_new(proposed)
        _, bad = crowd.misfits()
        crowd.leave_out(self._out(np.array(sorted(self.absent), dtype=np.int64)))
        crowd.solve(crowd.around(moved | bad), "around grains that fit badly")
        crowd.discount_ellipsoids()
        crowd.changed = True
        return True

    def _with_new(self, proposed: list[Ellipsoid]) -> bool:
        """Whether the whole fits better beside one of the new grains that parts found, once it is solved for anew.

        The one that helps most is kept; others may only have made up for it.
        """
        crowd, (_, bad) = self.crowd, self.crowd.misfits()
        affected, before = crowd.around(bad), crowd.problem.cost(crowd.own_pose)
        former = best = replace(crowd)
        least = before * (1 - MIN_NEW_SHARES / len(crowd.rows))
        for one in proposed[:MAX_PROPOSED]:
            self.crowd = replace(former, ellipsoids=list(former.ellipsoids))
            self.crowd.add(ellipsoid_images([one], former.fit.target.scan.geometry), (one,))
            self._from_field(former.out, affected, "beside a new grain")
            cost = self.crowd.problem.cost(self.crowd.own_pose)
            if cost < least:
                least, best = cost, self.crowd
        self.crowd = best
        if best is former:
            return False
        best.discount_ellipsoids()
        best.changed = True
        return True

    def _keep(self, trial: Trial, part: Part, rows: NDArray[np.int64]) -> None:
        """Keep what the trials of a part show of the grains of ``rows`` of the sample."""
        found = trial.motions
        good = registered(found)
        self.crowd.take(rows[good], some(_pose_of(found), np.flatnonzero(good)))
        self.absent |= set(rows[found.statuses == Status.ABSENT.value].tolist())  # to be asked in the end
        self.told |= {int(row): found for row in rows[found.statuses == Status.BROKEN.value]}
        self.pieces += found.fit.pieces
        self.crowd.add(part.image(self.crowd.fit.target, trial.attempt), trial.attempt.new)

    # ------------------------------------------------------------------ the end
    def finished(self) -> Trial:
        """The motions of all grains, once nothing more is explained."""
        crowd, near = self.crowd, self.crowd.near
        if self.absent:
            asked = np.array(sorted(self.absent), dtype=np.int64)
            gone = self._asked(asked, MAX_ABSENT_AMPLITUDE)
            if len(gone) < len(asked):
                crowd.leave_out(self._out(gone))
                crowd.solve(crowd.around(np.isin(np.arange(len(crowd.out)), asked)), "with those that are there")
                self.absent = set(gone.tolist())
        solution = crowd.solve_all() if crowd.changed else near.solution
        start, fields = some(near.start, crowd.rows), [some(pose, crowd.rows) for pose in near.fields]
        nothing = np.zeros(len(crowd.rows), dtype=bool)
        attempt = finish(crowd.job, Approach(crowd.fit, start, fields, crowd.problem, solution, nothing))
        motions = self._of_all(attempt.motions)
        complete = not crowd.ellipsoids and np.isfinite(motions.translations).all()
        residual = attempt.residual if complete else None
        return Trial(crowd.sample, Attempt(motions, np.ones(len(motions)), residual), motions)

    def _of_all(self, found: Motions) -> Motions:
        """Motions of all grains of the sample."""
        sample = self.crowd.sample.grains
        motions = found.for_grains(sample.labels, sample.centers)
        reasons = list(motions.reasons)
        for row, part in self.told.items():
            source = int(np.flatnonzero(part.labels == sample.labels[row])[0])
            for name in COPIED:
                getattr(motions, name)[row] = getattr(part, name)[source]
            reasons[row] = part.reasons[source]
        doubtful = np.flatnonzero(found.statuses == Status.NOT_CONVERGED.value)
        near = cKDTree(found.centers[doubtful]) if len(doubtful) else None
        for row in self.absent:
            motions.translations[row] = motions.rotations[row] = np.nan
            motions.statuses[row], reasons[row] = Status.ABSENT.value, MISSING_REASON
            if near is not None:
                distance, k = near.query(sample.centers[row])
                if distance < NEIGHBOUR_DIAMETERS * self.crowd.diameter:
                    motions.statuses[row] = Status.NOT_CONVERGED.value
                    reasons[row] = EITHER_REASON.format(label=int(found.labels[doubtful[k]]))
        fit = replace(motions.fit, appeared=new_grains(self.crowd.ellipsoids), pieces=tuple(self.pieces))
        return replace(motions, reasons=tuple(reasons), fit=fit)


def _pose_of(motions: Motions) -> Pose:
    return Pose(motions.translations, motions.matrices)


def _explains(trial: Trial, part: Part) -> bool:
    """Whether a trial explains the grain in the middle of its part, and more grains than fitted before."""
    found = trial.motions
    known = registered(found) | np.isin(found.statuses, EXPLAINED)
    return bool(known[part.rows == part.middle].all() and known.sum() > (~part.bad).sum())
