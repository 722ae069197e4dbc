"""The JSON documents of commands, made from results."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import grainmotion
from grainmotion.cli import documents as d
from grainmotion.model.finding import Finding, worst_first

if TYPE_CHECKING:
    from grainmotion.analysis.validation import Comparison
    from grainmotion.cli.failures import Failure
    from grainmotion.experiment.inspection import ScanFacts
    from grainmotion.model.motions import Motions
    from grainmotion.planning.plan import Plan
    from grainmotion.workflow.run import RunResult


def document_text(
    command: str,
    result: d.Document | None,
    findings: tuple[Finding, ...],
    ending: tuple[int, str],
    failed: Failure | None = None,
) -> str:
    """The document of a command as JSON; ``ending`` is the exit code and its reason."""
    error = None
    if failed is not None:
        log = None if failed.log is None else str(failed.log.absolute())
        error = d.ErrorOutcome(failed.kind, failed.where, failed.fact, failed.remedy, log)
    found = [d.FindingOutcome(**f.to_dict()) for f in worst_first(findings)]
    envelope = d.Envelope(d.SCHEMA, grainmotion.__version__, command, *ending, error, found, result)
    readable = (getattr(sys.stdout, "encoding", None) or "").lower() in ("utf-8", "utf8")
    return json.dumps(_plain(dataclasses.asdict(envelope)), indent=2, ensure_ascii=not readable)


def _plain(value: object) -> object:
    """Data as JSON holds it: numbers that are none become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def run_outcome(result: RunResult) -> d.RunOutcome:
    """The results of a run."""
    from grainmotion.workflow.log import RUN_LOG
    from grainmotion.workflow.provenance import StageCache

    folder = result.folder.absolute()
    files = sorted({file.absolute() for file in StageCache(folder).all_files()})
    return d.RunOutcome(
        folder=str(folder),
        report=None if result.report is None else str(result.report.absolute()),
        log=str(folder / RUN_LOG),
        done=list(result.done),
        kept=list(result.reused),
        states=[state_result(name, motions, folder, files) for name, motions in result.motions.items()],
        files=[str(file) for file in files if not {folder / name for name in result.motions} & set(file.parents)],
    )


def state_result(name: str, motions: Motions, folder: Path, files: list[Path]) -> d.StateResult:
    """How the tracking of a state went, with those of the files that lie in its folder."""
    import numpy as np

    from grainmotion.report.tables import scene_sentences

    statuses, counts = np.unique(motions.statuses, return_counts=True)
    u = np.linalg.norm(motions.translations[motions.ok_translation], axis=1)
    w = np.rad2deg(np.linalg.norm(motions.rotations[motions.ok_rotation], axis=1))
    rows = zip(motions.labels, motions.statuses, motions.reasons, motions.ok, strict=True)
    return d.StateResult(
        name=name,
        grains=len(motions),
        converged=int(motions.ok.sum()),
        translations=len(u),
        rotations=len(w),
        statuses={str(status): int(count) for status, count in zip(statuses, counts, strict=True)},
        median_translation=float(np.median(u)) if len(u) else None,
        median_rotation=float(np.median(w)) if len(w) else None,
        look_at=[d.GrainToLookAt(int(label), str(status), reason) for label, status, reason, ok in rows if not ok],
        remarks=list(scene_sentences(motions.fit)),
        files=[str(file) for file in files if folder / name in file.parents],
    )


def scan_outcome(facts: ScanFacts) -> d.ScanOutcome:
    """A scan of an experiment."""
    names = [field.name for field in dataclasses.fields(d.ScanOutcome) if field.name != "masked_pixels"]
    return d.ScanOutcome(**{name: getattr(facts, name) for name in names}, masked_pixels=int(facts.pixels.bad))


def plan_outcome(plan: Plan, folder: Path) -> d.PlanOutcome:
    """A plan."""
    rows = plan.angles_table().to_dict("records")
    sets = [
        d.ViewSetOutcome(
            views=len(views),
            kind=str(views.kind),
            angles=[float(angle) for angle in views.angles_deg],
            sd_translation=float(row["sd_u_mm"]),
            sd_rotation=float(row["sd_w_deg"]),
            worst_sd_translation=float(row["worst_sd_u_voxel"]),
            worst_sd_rotation=float(row["worst_sd_w_deg"]),
            captured=[(float(diameters), float(angle)) for diameters, angle in views.capture.ranges],
        )
        for views, row in zip(plan.sets, rows, strict=True)
    ]
    return d.PlanOutcome(str(folder.absolute()), len(plan.labels), sets)


def comparison_outcomes(comparisons: Mapping[str, Comparison]) -> list[d.ComparisonOutcome]:
    """Errors of the states against the truth."""
    return [
        d.ComparisonOutcome(name, len(c), c.failures, float(c.translation_rms_voxels), float(c.rotation_rms_deg))
        for name, c in comparisons.items()
    ]
