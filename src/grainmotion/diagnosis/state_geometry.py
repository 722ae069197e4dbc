"""Check of a later state before it is tracked: do its radiographs fit the reference under the geometry given?

Each view is compared with a coarse radiograph of the reference, moved as one body (`coarse_likeness`): under the
geometry given, and under the usual mistakes (`state_hypotheses`).  The share of a radiograph's power that stays
unexplained is 1 - likeness²; a mistake is named if undoing it lowers that share clearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from grainmotion._arguments import checked_arguments, renamed_arguments
from grainmotion.diagnosis.coarse_likeness import Fit, Likeness
from grainmotion.diagnosis.hypotheses import HYPOTHESES, OR_WRITE, stage_angles_deg
from grainmotion.diagnosis.state_hypotheses import (
    Candidate,
    Sweep,
    alike,
    as_given,
    double_mistakes,
    gain,
    other_order,
    other_scales,
    other_starts,
    single_mistakes,
    twin,
)
from grainmotion.diagnosis.state_views import (
    FEW_GRAINS,
    StrangeView,
    ViewNames,
    blank_views,
    repeated_views,
    strange_views,
)
from grainmotion.model.finding import Finding, Level
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.starting_pose import starting_pose

CLEAR_LEAD = 0.25
"""Gain of the geometry as given over the median of the usual mistakes, from which nothing else is tried."""
LEAST_LEAD = 0.5
"""The same of each view, over the median of the views; views of twelve stones have 0.78 at least."""
CLEAR_LOSS = 0.5
"""Gain of a usual mistake in one view alone up to which nothing else is tried; see `MIN_GAIN_OF_ONE`."""
MIN_GAIN, MIN_GAIN_ONE_VIEW = 0.2, 0.4
"""Gain from which a usual mistake is named: the first and, divided by the number of views, the second.  Good states
have up to 0.31 with one view, 0.14 with two, 0.13 with more (decision 0024)."""
FREE_GAIN = 0.4
"""What is asked in addition of a start or a scale, as many are tried, of small changes of the angles, and of the order
of two views.  Good states have up to 0.62 with two views, 0.42 with more; one view alone is not tried.  Another order
of three views or more needs no more than a usual mistake: good states have up to 0.11 (12 hard cases and 5 to 8 stones
that moved by up to 5 voxels and 10 degrees), permuted ones of stones that moved by 3 voxels 0.33 to 1.9."""
SMALL_CHANGES = ("end-point-counted", "end-point-left-out")
"""Hypotheses that a rotation of the sample between the states can imitate."""
SIMILAR_GAIN = 0.15
"""Gain up to which two hypotheses are both named."""
MAX_NAMED = 2
"""Mistakes that are named beside the most likely one."""
MIN_LEAD = 0.1
"""Gain over the median of all angles below which the state may be one of another sample.  Good states of three views or
more have 0.13 at least, other samples of 20 grains -0.06 and of 12 grains -0.07 to 0.03."""
MAX_STRANGE_LIKENESS, MAX_STRANGE_LIKENESS_FEW = 0.7, 0.58
"""Likeness from which that is not said, for three views or more and for fewer: good states of one or two views have
leads down to 0.02 beside a likeness of 0.62.  Other samples have 0.35 (20 grains), 0.43 to 0.64 (12 grains)."""
FEW_VIEWS = 2


@dataclass(frozen=True, eq=False)
class Trial:
    """A hypothesis and how well the views fit under it."""

    candidate: Candidate
    fit: Fit


@renamed_arguments(start="initial")
@checked_arguments
def check_state(
    grains: GrainSet,
    scan: Scan,
    initial: Motions | None = None,
    *,
    where: str = "scan",
    names: Sequence[str] = (),
) -> tuple[Finding, ...]:
    """Compare the radiographs of a later state with the reference before the state is tracked.

    The reference moves as one body; its coarse radiographs are compared with those of the state under the geometry
    given and under the usual mistakes: flipped, transposed or permuted radiographs, angles with the wrong sign, in
    radians, with another start or span, other pixels; single views that are blank, repeated or of something else.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state.
    scan : Scan
        Radiographs of the later state, as for `track`.
    initial : Motions, optional
        Motions from which tracking starts; none is no motion.
    where : str
        What the findings are about, such as the key of the state.
    names : sequence of str
        Names of the radiographs, such as their files; none if they have none.

    Returns
    -------
    tuple of Finding
        Empty if the state fits.  A finding of level "error" means that tracking would fail.

    Examples
    --------
    >>> gm.check_state(grains, state)  # nothing is wrong
    ()
    """
    with threadpool_limits(limits=1, user_api="blas"):  # matrices are small: threads would wait for each other
        return _checked(grains, scan, initial, ViewNames(where, tuple(names)))


def _checked(grains: GrainSet, scan: Scan, initial: Motions | None, words: ViewNames) -> tuple[Finding, ...]:
    """What is wrong with the views that show something, and which show nothing or one thing twice."""
    count = len(scan)
    likeness = Likeness.of(grains, starting_pose(grains, initial), scan)
    blank = blank_views(likeness, scan)
    findings = words.blank([int(k) for k in np.flatnonzero(blank)], count)
    kept = [int(k) for k in np.flatnonzero(~blank)]
    if not kept:
        return tuple(findings)
    shown, scan = likeness.select(kept), scan.select(kept)
    pairs = repeated_views(shown, scan)
    findings += words.repeated([(kept[i], kept[j]) for i, j in pairs], count)
    rest = [k for k in range(len(kept)) if k not in {j for _, j in pairs}]
    state = _State(shown.select(rest), len(grains), words, [kept[k] for k in rest], count)
    return tuple(findings + state.findings())


@dataclass(frozen=True, eq=False)
class _State:
    """A state under test: the views that show a sample, their numbers, and that of all views.

    ``undone`` says that a mistake has been undone already.
    """

    likeness: Likeness
    grains: int
    words: ViewNames
    kept: list[int]
    count: int
    undone: bool = False

    def findings(self) -> list[Finding]:
        """What is wrong with the geometry as a whole, or with single views."""
        now = self._trial(as_given(self.likeness))
        candidates = single_mistakes(self.likeness)
        bounds = [Fit(self.likeness.best(c.images, c.geometry)) for c in candidates]
        if bounds and not self.undone and _is_clear(now.fit, bounds, self.grains):
            return []
        changes = [self._trial(c) for c in candidates]
        singles = [t for t in changes if t.candidate.fixes[0] not in SMALL_CHANGES]
        sweep = Sweep.of(self.likeness)
        strange = strange_views(self.likeness, sweep, self.grains)
        doubles = [c for c in double_mistakes(self.likeness) if c.fixes[0] not in SMALL_CHANGES]
        named = singles + [self._trial(c) for c in doubles]
        order = [self._trial(c) for c in other_order(self.likeness, sweep)]
        small = [t for t in changes if t.candidate.fixes[0] in SMALL_CHANGES]
        free = [self._trial(c) for c in (*other_starts(self.likeness, sweep), *other_scales(self.likeness))]
        best = _best(now, named, order, [*small, *free], len(self.kept))
        if best is not None:
            beside = self._beside(best.candidate)
            return [self._mistake(now, best, [] if beside else [*named, *order]), *beside]
        if strange:
            return [self._strange(view) for view in strange]
        return [] if self.undone else self._unlike(now, named, sweep)

    def _beside(self, mistake: Candidate) -> list[Finding]:
        """What else is wrong once a mistake is undone."""
        if self.undone or mistake.images.shape != self.likeness.measured.shape:
            return []
        likeness = replace(self.likeness, measured=mistake.images, geometry=mistake.geometry)
        found = replace(self, likeness=likeness, undone=True).findings()
        return [replace(f, fact=f"beside that, {f.fact}", fix="") for f in found]

    def _trial(self, candidate: Candidate) -> Trial:
        return Trial(candidate, candidate.fit(self.likeness))

    def _mistake(self, now: Trial, best: Trial, others: list[Trial]) -> Finding:
        """The mistake that explains the state, and others that explain it as well."""
        likely = best.candidate
        similar = [t.candidate for t in others if t is not best and gain(t.fit, best.fit) < SIMILAR_GAIN]
        equals = [c for c in similar if len(c.fixes) == 1]
        equals += [c for c in similar if not c.fixes and not any(alike(c, other) for other in (likely, *equals))]
        choices = [(c.fixes, c.text) for c in (likely, *equals[:MAX_NAMED])]
        behind = twin(likely)
        if 0 < len(behind) <= MAX_NAMED and behind not in [fixes for fixes, _ in choices]:
            choices.insert(1, (behind, ", and ".join(HYPOTHESES[name].mistake for name in behind)))
        fact = "its views do not fit the reference" + ("" if self.undone else " as given")
        fact += "; probably " + ", or ".join(text for _, text in choices)
        fact += " (or the reference is upside down)" if likely.panel == "rows-flipped" else ""
        state = "with that undone" if self.undone else "as given"
        evidence = f"likeness to the reference {now.fit.mean:.2f} {state}, {best.fit.mean:.2f} so; 1 is equal"
        remedies = [HYPOTHESES[name].remedy for name in likely.fixes]
        remedy = "; ".join(remedies or [likely.remedy or "correct angles_deg, or the order of the files"])
        named = [fixes for fixes, _ in choices if fixes]
        if named:
            keys = " or ".join("fixes = [" + ", ".join(f'"{name}"' for name in fixes) + "]" for fixes in named)
            remedy += f"{OR_WRITE}{keys} in the state's table"
        return self.words.finding(Level.ERROR, fact, evidence, remedy, ", ".join(likely.fixes))

    def _strange(self, odd: StrangeView) -> Finding:
        """A view that does not belong to the others."""
        fact = f"{self.words(self.kept[odd.view])} does not fit the reference at its angle, though the other views do"
        if odd.flipped:
            fact += ": its rows seem to run the other way"
        elif odd.angle_deg is None:
            fact += ": probably another sample, or a damaged radiograph"
        else:
            fact += f": it seems to be taken at about {odd.angle_deg:g} degrees"
            fact += ", or its columns are flipped" if self._is_behind(odd.view, odd.angle_deg) else ""
        evidence = f"likeness {odd.likeness:.2f}, of the others {odd.others:.2f}; 1 is equal"
        return self.words.finding(Level.ERROR, fact, evidence, self.words.without([self.kept[odd.view]], self.count))

    def _is_behind(self, view: int, angle: float) -> bool:
        given = stage_angles_deg(self.likeness.geometry)[view]
        return abs((angle - given) % 360 - 180) < 15

    def _unlike(self, now: Trial, named: list[Trial], sweep: Sweep) -> list[Finding]:
        """A state that fits under no hypothesis."""
        given = np.diagonal(sweep.at(stage_angles_deg(self.likeness.geometry)))
        lead = gain(float(np.median(sweep.upright, axis=1).mean()), float(given.mean()))
        few = len(self.kept) <= FEW_VIEWS
        if lead > MIN_LEAD or now.fit.mean > (MAX_STRANGE_LIKENESS_FEW if few else MAX_STRANGE_LIKENESS):
            return []
        best = max(named, key=lambda t: t.fit.mean) if named else now
        fact = "its radiographs look no more like the reference as given than from any other side: "
        fact += "probably another sample, or motions of more than a grain"
        evidence = (
            f"likeness {now.fit.mean:.2f} as given, {best.fit.mean:.2f} at best of the usual mistakes; 1 is equal"
        )
        remedy = 'check radiographs and geometry of this state, or start from a nearer state: initial = "previous"'
        return [self.words.finding(Level.WARNING, fact, evidence, remedy)]


def _is_clear(now: Fit, bounds: list[Fit], grains: int) -> bool:
    """Whether the geometry as given is better than all usual mistakes can be, and clearly than most of them.

    Where single views of few grains are not judged, the mean of the views counts, else each view.  A view that fits
    much better flipped, or much worse than the others, is looked at closer.
    """
    usual = np.median([fit.each for fit in bounds], axis=0)
    leads = np.array([gain(u, f) for u, f in zip(usual, now.each, strict=True)])
    lead, least = leads.mean(), 0.0
    if grains >= FEW_GRAINS:
        lead, least = leads.min(), LEAST_LEAD * np.median(leads)
    best = np.max([fit.each for fit in bounds], axis=0)
    odd = max(gain(f, b) for f, b in zip(now.each, best, strict=True))
    return bool(lead > max(CLEAR_LEAD, least) and odd < CLEAR_LOSS and all(gain(now, fit) < 0 for fit in bounds))


def _best(now: Trial, named: list[Trial], orders: list[Trial], free: list[Trial], views: int) -> Trial | None:
    """The hypothesis that explains the state clearly better than the geometry as given; the simplest if several do."""
    least = MIN_GAIN + MIN_GAIN_ONE_VIEW / views
    first, order, other = _highest(named), _highest(orders), _highest([*orders, *free])
    beaten = first is not None and other is not None and gain(first.fit, other.fit) > FREE_GAIN
    if first is not None and gain(now.fit, first.fit) > least and not beaten:
        return _simplest(first, named)
    if other is not None and views > 1 and gain(now.fit, other.fit) > least + FREE_GAIN:
        return other
    if order is not None and views > FEW_VIEWS and gain(now.fit, order.fit) > least:
        return order
    return None


def _highest(trials: list[Trial]) -> Trial | None:
    return max(trials, key=lambda t: t.fit.mean) if trials else None


def _simplest(best: Trial, named: list[Trial]) -> Trial:
    """A single mistake in place of two at once, if it explains nearly as much."""
    singles = [t for t in named if len(t.candidate.fixes) == 1]
    single = max(singles, key=lambda t: t.fit.mean)
    return single if gain(single.fit, best.fit) < SIMILAR_GAIN else best
