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
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import check_argument
from grainmotion._typing import Progress
from grainmotion.cluster.connection import LOCAL, ComputeConfig, connect
from grainmotion.diagnosis.results import check_motions
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import Inputs, find_inputs
from grainmotion.io.files import checked_folder
from grainmotion.io.results import StoredReference
from grainmotion.io.results_folder import ResultsFolder, results_summary
from grainmotion.io.series_files import check_parquet
from grainmotion.model.finding import Finding, worst_first
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.progress import listening
from grainmotion.model.summary import MAX_ITEMS, Summarised, Summary, names_text
from grainmotion.model.volume import Volume
from grainmotion.report.tables import scene_sentences
from grainmotion.sequences.series import Series
from grainmotion.workflow.beam_level_stage import BEAM_LEVEL, level_reference
from grainmotion.workflow.calibration_stage import CALIBRATION, calibrate_stage, calibration_findings
from grainmotion.workflow.checks import check_files, check_radiographs, check_reference, check_version
from grainmotion.workflow.context import RunContext, check_inputs
from grainmotion.workflow.exports import DEFORMED, REFERENCE_TIFFS, RESULT_STORES
from grainmotion.workflow.folder_lock import only_process
from grainmotion.workflow.given_checks import check_given, check_grains
from grainmotion.workflow.log import STAGE_LOG, run_log
from grainmotion.workflow.memory import memory_of_run
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


@dataclass(frozen=True, eq=False, repr=False)
class RunResult(Summarised):
    """Results of a run; what is not listed here is read from the folder when it is first asked for.

    Attributes
    ----------
    folder : Path
        Where they are.
    motions : dict of str to Motions
        Motions of each state by its name, in loading order.
    done, reused : tuple of str
        Stages that this run did, in order, and those that an earlier run had done.
    report : Path, optional
        The page on all states.
    findings : tuple of Finding
        Of all checks, the worst first.

    Examples
    --------
    >>> result = gm.run(gm.read_experiment("experiment.toml"))  # all is done already: nothing is repeated
    >>> list(result.motions), len(result.grains)
    (['step-01', 'step-02'], 6)
    """

    folder: Path
    motions: dict[str, Motions]
    done: tuple[str, ...]
    reused: tuple[str, ...]
    report: Path | None = None
    findings: tuple[Finding, ...] = ()

    @cached_property
    def results(self) -> ResultsFolder:
        """The folder of the results; what is asked of it is read then."""
        return ResultsFolder(self.folder, self.motions)

    @property
    def reference(self) -> StoredReference:
        """The reference as stored in ``reference.h5``, read when it is first asked for."""
        return self.results.reference

    @property
    def volume(self) -> Volume:
        """The volume of the reference, 1/mm."""
        return self.results.volume

    @property
    def labels(self) -> NDArray[np.int32]:
        """Labels of its grains ``(nz, ny, nx)``, 0 for none."""
        return self.results.labels

    @property
    def grains(self) -> GrainSet:
        """The grains with their own voxels, as they were tracked."""
        return self.results.grains

    @property
    def series(self) -> Series:
        """The motions of all states in loading order."""
        return self.results.series

    def _summary(self) -> Summary:
        rows = [("done", names_text(self.done) or "nothing"), ("reused", names_text(self.reused) or "nothing")]
        rows += [("report", str(self.report))] if self.report is not None else []
        rows += [(finding.level, finding.line) for finding in self.findings[:MAX_ITEMS]]
        return results_summary("RunResult", self.folder, self.motions, tuple(rows))


def run(
    experiment: Experiment,
    *,
    out: str | Path | None = None,
    until: Until = "report",
    progress: Progress | None = None,
    workplace: ComputeConfig = LOCAL,
) -> RunResult:
    """Run all stages of an experiment, or those up to ``until``.

    Parameters
    ----------
    experiment : Experiment
        A file read by `read_experiment`.
    out : str or Path, optional
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

    Examples
    --------
    >>> result = gm.run(gm.read_experiment("experiment.toml"))
    >>> result.done  # all was there already
    ()
    """
    check_argument(
        "run(experiment)", experiment, ["Experiment"]
    )  # a decorator would be one more call above the kernels
    check_argument("run(out)", out, ["str", "Path", "None"])
    check_formats(experiment)
    inputs, with_states = find_inputs(experiment), until in ("track", "report")
    folder = checked_folder(Path(out) if out is not None else experiment.output)
    check_overwriting(inputs, folder)
    place = "" if workplace == LOCAL else f", {workplace}"
    tracked: dict[str, TrackedState] = {}
    report = None
    with (
        listening(progress) as listener,
        connect(workplace, folder) as cluster,
        memory_of_run(inputs, folder, workplace),
    ):
        context = RunContext(experiment, inputs, folder, StageCache(folder), listener, cluster)
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
                del reconstruction  # of which the reference has the volume
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
