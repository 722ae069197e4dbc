"""Run: the stages of an experiment in their order, from its file to the report.

    radiographs → level of the beam → calibrate → reconstruct → segment → grains → track state by state
                → residuals, rebuilt, exports → report

All inputs are read and checked before anything is written.  When a stage's files are complete, ``stages.json`` records
a fingerprint of its inputs; a stage recorded with the same fingerprint is not repeated.  So a run that was stopped
continues where it was, and a changed setting repeats only the stages that depend on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from grainmotion._arguments import check_argument
from grainmotion._typing import Progress
from grainmotion.cluster.connection import LOCAL, ComputeConfig, connect
from grainmotion.diagnosis.results import check_motions
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import Inputs, find_inputs
from grainmotion.io.files import checked_folder
from grainmotion.io.results import StoredReference
from grainmotion.io.series_files import check_parquet
from grainmotion.model.finding import Finding, worst_first
from grainmotion.model.motions import Motions
from grainmotion.report.tables import scene_sentences
from grainmotion.workflow.beam_level_stage import BEAM_LEVEL, level_reference
from grainmotion.workflow.calibration_stage import CALIBRATION, calibrate_stage, calibration_findings
from grainmotion.workflow.checks import check_files, check_radiographs, check_reference, check_version
from grainmotion.workflow.context import RunContext, check_inputs
from grainmotion.workflow.exports import DEFORMED, REFERENCE_TIFFS, RESULT_STORES
from grainmotion.workflow.folder_lock import only_process
from grainmotion.workflow.given_checks import check_given, check_grains
from grainmotion.workflow.log import STAGE_LOG, run_log
from grainmotion.workflow.outputs import RESIDUALS, report_stage, write_outputs
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.reference_stages import CHECKPOINT, REFERENCE, reconstruct_stage, segment_stage
from grainmotion.workflow.results_description import describe_results
from grainmotion.workflow.tracking_stage import TrackedState, track_side_by_side, track_stage

Until = Literal["reconstruct", "segment", "track", "report"]

RESULT_FILES = {
    BEAM_LEVEL,
    CALIBRATION,
    REFERENCE,
    CHECKPOINT,
    "motions.h5",
    RESIDUALS,
    *(name for names in DEFORMED.values() for name in names),
    *REFERENCE_TIFFS,
}
"""Names of results that an input in the same folder could also have."""


@dataclass(frozen=True, eq=False)
class RunResult:
    """Results of a run."""

    folder: Path
    motions: dict[str, Motions]  # by the name of the state
    done: tuple[str, ...]  # stages that this run did, in order
    reused: tuple[str, ...]  # stages that an earlier run had done
    report: Path | None = None  # the page on all states
    findings: tuple[Finding, ...] = ()  # of all checks, the worst first


def run(
    experiment: Experiment,
    *,
    out: Path | None = None,
    until: Until = "report",
    progress: Progress | None = None,
    workplace: ComputeConfig = LOCAL,
) -> RunResult:
    """Run all stages of an experiment, or those up to ``until``.

    Parameters
    ----------
    experiment : Experiment
        A file read by `read_experiment`.
    out : Path, optional
        Folder of the results; by default ``[output] directory``.
    until : {"reconstruct", "segment", "track", "report"}
        The last stage to do.
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    workplace : ComputeConfig, optional
        Processes that compute; by default this one.  The results do not depend on it.

    Returns
    -------
    RunResult
        The motions, and the folder of all results.

    Raises
    ------
    InputError
        If an input cannot be used; nothing is written then.
    BackendError
        If the device asked for cannot be used.
    """
    check_argument("run(experiment)", experiment, ["Experiment"])
    check_formats(experiment)
    inputs, with_states = find_inputs(experiment), until in ("track", "report")
    folder = checked_folder(out if out is not None else experiment.output)
    check_overwriting(inputs, folder)
    place = "" if workplace == LOCAL else f", {workplace}"
    tracked: dict[str, TrackedState] = {}
    report = None
    with connect(workplace, folder) as cluster:
        context = RunContext(experiment, inputs, folder, StageCache(folder), progress, cluster)
        check_files(context, states=with_states)
        check_inputs(context, states=with_states)
        with only_process(folder, context.cache), run_log(folder, experiment, inputs, f"run until {until}{place}"):
            for finding in context.findings:  # before there was a log
                STAGE_LOG.info(finding.line)
            check_version(context)
            check_radiographs(context, states=with_states)
            reconstruction = reconstructed(context)
            if until != "reconstruct":
                reference = segment_stage(context, reconstruction)
                check_grains(context, reference)
            if with_states:
                tracked = track_side_by_side(context, reference)
                for table in experiment.tables.states:
                    if table.name not in tracked:
                        tracked[table.name] = context.complete(track_stage(context, reference, table.name, tracked))()
                    note_motions(context, table.name, tracked[table.name].motions)
                tracked = {table.name: tracked[table.name] for table in experiment.tables.states}
            motions = {name: state.motions for name, state in tracked.items()}
            if until == "report":
                write_outputs(context, reference, tracked)
                report = report_stage(context, reference, motions)
            describe_results(folder, experiment)
    findings = worst_first(context.findings)
    return RunResult(folder, motions, tuple(context.done), tuple(context.reused), report, findings)


def check_formats(experiment: Experiment) -> None:
    """Refuse formats of results for which a library is missing."""
    if "parquet" in experiment.tables.output.series:
        check_parquet("output.series")


def reconstructed(context: RunContext) -> Callable[[], StoredReference]:
    """The reference volume from checked and calibrated radiographs, or as given."""
    level_reference(context)
    check_reference(context)
    check_given(context)
    context.scanner = calibrate_stage(context)
    if context.inputs.reference is not None:
        context.add(calibration_findings(context.scanner(), context.inputs.reference.geometry))
    return reconstruct_stage(context)


def note_motions(context: RunContext, name: str, motions: Motions) -> None:
    """Record what the motions of a state show."""
    context.add(check_motions(name, motions, context.findings_on(f"states.{name}")))
    STAGE_LOG.info("%s: %s grains usable", name, motions.counts)
    for sentence in scene_sentences(motions.fit):
        STAGE_LOG.info("%s: %s", name, sentence)


def check_overwriting(inputs: Inputs, folder: Path) -> None:
    """Refuse to write results over inputs."""
    scans = [s for s in (inputs.reference, *inputs.states) if s is not None]
    files = [f for s in scans for f in s.files] + [f for s in (inputs.volume, inputs.labels) if s for f in s.files]
    folders = {folder.resolve(), *(folder.resolve() / s.key.removeprefix("states.") for s in inputs.states)}
    for file in files:
        store = next((p for p in file.resolve().parents if p.name in RESULT_STORES), None)
        if store is not None and store.parent in folders:
            fact = f"{store} holds an input and would be overwritten"
            raise InputError("output.directory", fact, "choose another folder for the results")
        if file.resolve().parent in folders and file.name in RESULT_FILES:
            fact = f"{file} is an input and would be overwritten"
            raise InputError("output.directory", fact, "choose another folder for the results")
