"""Run: the stages of an experiment in their order, from its file to the report.

    radiographs → calibrate → reconstruct → segment → grains → track state by state
                → residuals, rebuilt, exports → report

Everything is read and checked before anything is written.  Each stage's files are written whole, then entered in
``stages.json`` with a fingerprint of all they were made from; a stage that stands there with the same fingerprint is
not done again.  So a run that was stopped continues where it was, and a changed setting redoes what depends on it and
nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from grainmotion._typing import Progress
from grainmotion.cluster.connection import LOCAL, ComputeConfig, connect
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import Inputs, find_inputs
from grainmotion.io.files import checked_folder
from grainmotion.model.motions import Motions
from grainmotion.workflow.calibration_stage import CALIBRATION, calibrate_stage
from grainmotion.workflow.context import RunContext, check_inputs
from grainmotion.workflow.outputs import DEFORMED, REFERENCE_EXPORTS, RESIDUALS, report_stage, write_outputs
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.reference_stages import CHECKPOINT, REFERENCE, reconstruct_stage, segment_stage
from grainmotion.workflow.tracking_stage import track_side_by_side, track_stage

Until = Literal["reconstruct", "segment", "track", "report"]

WRITTEN = {CALIBRATION, REFERENCE, CHECKPOINT, "motions.h5", RESIDUALS, *DEFORMED, *REFERENCE_EXPORTS["spam"]}
"""Results that an input could be called, too."""


@dataclass(frozen=True, eq=False)
class RunResult:
    """What a run left behind.

    Attributes
    ----------
    folder : Path
        Where the results are.
    motions : dict of str to Motions
        By the name of the state.
    done : tuple of str
        Stages that this run worked on, in order.
    reused : tuple of str
        Stages that were there already.
    report : Path, optional
        The page on all states.
    """

    folder: Path
    motions: dict[str, Motions]
    done: tuple[str, ...]
    reused: tuple[str, ...]
    report: Path | None = None


def run(
    experiment: Experiment,
    *,
    out: Path | None = None,
    until: Until = "report",
    progress: Progress | None = None,
    workplace: ComputeConfig = LOCAL,
) -> RunResult:
    """Do an experiment's whole job, or its stages up to ``until``.

    Parameters
    ----------
    experiment : Experiment
        A file read by `read_experiment`.
    out : Path, optional
        Where results go; by default ``[output] directory``.
    until : {"reconstruct", "segment", "track", "report"}
        The last stage to do.
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    workplace : ComputeConfig, optional
        Who computes: this process unless given otherwise.  The results do not depend on it.

    Returns
    -------
    RunResult
        The motions, and where all results are.

    Raises
    ------
    InputError
        If anything that was given cannot be used; nothing is written then.
    BackendError
        If the device asked for cannot be used.
    """
    inputs = find_inputs(experiment)
    folder = checked_folder(out if out is not None else experiment.output)
    _check_overwriting(inputs, folder)
    with connect(workplace, folder) as cluster:
        context = RunContext(experiment, inputs, folder, StageCache(folder), progress, cluster)
        check_inputs(context, states=until in ("track", "report"))
        context.scanner = calibrate_stage(context)
        reconstruction = reconstruct_stage(context)
        motions: dict[str, Motions] = {}
        report = None
        if until != "reconstruct":
            reference = segment_stage(context, reconstruction)
            if until != "segment":
                tracked = track_side_by_side(context, reference)
                for table in experiment.tables.states:
                    if table.name not in tracked:
                        tracked[table.name] = context.complete(track_stage(context, reference, table.name, tracked))()
                motions = {table.name: tracked[table.name].motions for table in experiment.tables.states}
                if until == "report":
                    write_outputs(context, reference, tracked)
                    report = report_stage(context, reference, motions)
        return RunResult(folder, motions, tuple(context.done), tuple(context.reused), report)


def _check_overwriting(inputs: Inputs, folder: Path) -> None:
    """Refuse to write results over what was measured."""
    scans = [s for s in (inputs.reference, *inputs.states) if s is not None]
    given = [f for s in scans for f in s.files] + [f for s in (inputs.volume, inputs.labels) if s for f in s.files]
    folders = {folder.resolve(), *(folder.resolve() / s.key.removeprefix("states.") for s in inputs.states)}
    for file in given:
        if file.resolve().parent in folders and file.name in WRITTEN:
            fact = f"{file} is an input and would be overwritten"
            raise InputError("output.directory", fact, "choose another folder for the results")
