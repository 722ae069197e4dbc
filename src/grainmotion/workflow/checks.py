"""Checks of a run: their findings are kept like the results of a stage, so that a later run shows them again.

A finding of level "error" stops the run unless ``[check] force`` is set.  A finding with a fix is applied if
``[check] try_fixes`` is set, and says so.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from grainmotion import __version__
from grainmotion.diagnosis.hypotheses import OR_WRITE
from grainmotion.diagnosis.scan_geometry import check_scan
from grainmotion.errors import InputError
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.findings_json import read_findings, write_findings
from grainmotion.model.finding import Finding, Level
from grainmotion.workflow.context import RunContext, load_result

CHECKS, RADIOGRAPHS = "checks.json", "radiographs.json"
Findings = tuple[Finding, ...]


def check_files(context: RunContext, *, states: bool) -> None:
    """Tell what names of files and told angles say about the scans that are used; an error stops the run at once."""
    for source in (context.inputs.reference, *(context.inputs.states if states else ())):
        if source is not None:
            settle(context, source, source.findings)
    if states:
        remedy = "rename it, or narrow the pattern; all other folders are used"
        left_out = context.experiment.left_out
        context.add(Finding(Level.WARNING, "file-series", "watch.folders", fact, remedy=remedy) for fact in left_out)


def check_version(context: RunContext) -> None:
    """Tell that the results in the folder are of another version of the package, so that they are made again."""
    before, now = context.cache.made_by, __version__
    if before not in ("", now):
        fact = f"the results are of version {before}, and this is {now}: all of them are made again"
        remedy = "install the former version to go on with them, or keep them and choose another folder with --out"
        context.add([Finding(Level.NOTE, "version", str(context.folder), fact, remedy=remedy)])


def check_radiographs(context: RunContext, *, states: bool) -> None:
    """Check frames and grey values of the scans that are used."""
    for source in (context.inputs.reference, *(context.inputs.states if states else ())):
        if source is not None:
            check_radiographs_of(context, source)


def check_radiographs_of(context: RunContext, source: ScanInput) -> None:
    """Check frames and grey values of one scan."""
    name = source.key.removeprefix("states.")
    folder = context.folder if name == source.key else context.folder / name
    check = functools.partial(_as_read, context, source)
    found = _findings(context, f"{source.key}/radiographs", folder / RADIOGRAPHS, source, check)
    settle(context, source, found)


def check_reference(context: RunContext) -> None:
    """Check the reference scan before anything is computed from it."""
    source = context.inputs.reference
    if source is None:
        return
    found = _findings(context, "check", context.folder / CHECKS, source, lambda: _reference_findings(context, source))
    settle(context, source, found)


def _reference_findings(context: RunContext, source: ScanInput) -> Findings:
    """All checks of the reference scan."""
    context.notify("checking the reference scan")
    return check_scan(context.measured(source), context.inputs.grid, context.tables.check, where=source.key)


def _as_read(context: RunContext, source: ScanInput) -> Findings:
    """Checks of frames and grey values of a scan."""
    if source.key not in context.as_read:
        context.measured(source)
        context.forget(source)
    return context.as_read[source.key]


def _findings(context: RunContext, name: str, path: Path, source: ScanInput, check: Callable[[], Findings]) -> Findings:
    """The findings of a check, from its file if an earlier run made it of the same input."""
    limits, grid = context.tables.check, context.inputs.grid
    settings = ["check", limits.warn, limits.stop, source.settings, grid.shape, grid.voxel_size, grid.center]
    return findings_once(context, name, path, context.cache.fingerprint(settings, source.files), check)


def findings_once(
    context: RunContext, name: str, path: Path, fingerprint: str, check: Callable[[], Findings]
) -> Findings:
    """The findings of a check of what has this fingerprint, from its file if an earlier run made it."""
    if context.cache.is_done(name, fingerprint):
        return load_result(read_findings, path) if path.is_file() else ()
    findings = check()
    context.cache.discard(name)
    path.unlink(missing_ok=True)
    if findings:  # nothing to tell leaves no file
        write_findings(path, findings)
    context.cache.add(name, fingerprint, [path] if findings else [])
    return findings


def settle(context: RunContext, source: ScanInput, findings: Findings) -> None:
    """Record findings; apply their fixes if that is wanted, and stop at an error unless forced."""
    check = context.tables.check
    if check.try_fixes:
        findings = tuple(applied(context, source, f) if f.fix else f for f in findings)
    errors = [f for f in findings if f.level is Level.ERROR and not check.force]
    context.add(f for f in findings if f not in errors[:1])  # the first error is raised instead
    if errors:
        worst = errors[0]
        remedy = f"{worst.remedy}; or go on with --force" if worst.remedy else "go on with --force"
        evidence = f" ({worst.evidence})" if worst.evidence else ""
        raise InputError(worst.where, worst.fact + evidence, f"{remedy} [{worst.check}]")


def applied(context: RunContext, source: ScanInput, finding: Finding) -> Finding:
    """The finding after its fix."""
    context.apply_fix(source, finding.fix)
    names = ", ".join(f'"{name}"' for name in finding.fix.split(", "))
    remedy = (
        f"the fix was applied; to keep it, write fixes = [{names}] there, or {finding.remedy.partition(OR_WRITE)[0]}"
    )
    return replace(finding, level=Level.WARNING, remedy=remedy)
