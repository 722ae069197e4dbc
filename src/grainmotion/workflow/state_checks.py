"""Check of each later state of a run before it is tracked; a state that cannot be tracked is refused, not the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from grainmotion.diagnosis.state_geometry import check_state
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.experiment.state_tracking import errors_of_state
from grainmotion.model.finding import Finding, Level, worst_first
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.workflow.checks import CHECKS, applied, findings_once
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.reference_stages import SegmentedReference

MAX_FIXES = 2
"""Fixes that are tried one after another on one state; each may undo two mistakes."""


def check_tracked_state(
    context: RunContext, reference: Callable[[], SegmentedReference], table: StateTable, start: Motions | None
) -> None:
    """Compare a state with the reference; apply what its findings propose if that is wanted, else refuse the state.

    Parameters
    ----------
    context : RunContext
        Its inputs change if a fix is applied, its refused states if the state is refused.
    reference : callable
        Gives the grains, if the check has to be made.
    table : StateTable
        The state.
    start : Motions, optional
        Motions from which it is tracked.
    """
    for attempt in range(1 + MAX_FIXES):
        source = next(s for t, s in context.states if t.name == table.name)
        findings = _findings(context, reference, table, source, start, attempt)
        fixable = [f for f in findings if f.fix] if context.tables.check.try_fixes and attempt < MAX_FIXES else []
        if not fixable:
            break
        context.add([applied(context, source, fixable[0])])  # the next check tells what is left
    context.add(findings)
    errors = [f for f in findings if f.level is Level.ERROR]
    if errors and not context.tables.check.force:
        context.refuse(table.name, worst_first(errors)[0])


def refused_motions(grains: GrainSet, finding: Finding) -> Motions:
    """Unknown motions of all grains of a state that is not tracked, with the finding as their reason."""
    nothing = np.full((len(grains), 3), np.nan)
    reason = f"the state was not tracked: {finding.fact}; see its finding"
    still = Motions.identity(grains.labels, grains.centers)
    return replace(still, translations=nothing, rotations=nothing.copy(), reasons=(reason,) * len(grains))


def _findings(
    context: RunContext,
    reference: Callable[[], SegmentedReference],
    table: StateTable,
    source: ScanInput,
    start: Motions | None,
    attempt: int,
) -> tuple[Finding, ...]:
    """The findings on a state after so many fixes, from their file if an earlier run made them of the same input."""
    fingerprint = context.cache.fingerprint("check of a state", (), [context.fingerprints.tracks[table.name]])

    def check() -> tuple[Finding, ...]:
        context.notify(f"{table.name}: comparing with the reference")
        grains, names = reference().grains, radiograph_names(source)
        with errors_of_state(source.key, table.initial):
            return check_state(grains, context.radiographs(source), start, where=source.key, names=names)

    path = context.folder / table.name / CHECKS
    name = f"{table.name}/check"
    if attempt:
        name, path = f"{name}-{attempt}", path.with_stem(f"{path.stem}-{attempt}")
    return findings_once(context, name, path, fingerprint, check)


def radiograph_names(source: ScanInput) -> tuple[str, ...]:
    """Names of the files of the views; none if files hold several."""
    files = [part.path.name for part in source.radiographs.parts]
    views = range(len(source.geometry)) if source.views is None else source.views
    if len(files) <= max(views):
        return ()
    return tuple(files[int(k)] for k in views)
