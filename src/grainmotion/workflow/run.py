"""Pipeline: the order of a run, from the experiment file to the report.  The only file that knows it.

    radiographs → calibrate → reconstruct → segment → grains → track state by state
                → residuals, rebuilt, exports → report

Everything is read and checked before anything is written.  Each stage's files are written whole, then
entered in the ledger with a fingerprint of all they were made from; a stage that stands there with the
same fingerprint is not done again.  So a run that was stopped goes on where it was, and a changed
setting redoes what depends on it and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from grainmotion._typing import Progress
from grainmotion.cluster.connection import LOCAL, ComputeConfig, at_work
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment, StateTable
from grainmotion.experiment.inputs import Inputs, find_inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.calibration_json import write_calibration
from grainmotion.io.files import checked_folder
from grainmotion.io.results import Reference, write_reference
from grainmotion.model.motions import Motions
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.segment import border_labels, segment
from grainmotion.workflow import outputs
from grainmotion.workflow.calibration_stage import calibrate_machine
from grainmotion.workflow.context import CALIBRATION, CHECKPOINT, REFERENCE, RunContext
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.tracking_stage import track_states

Until = Literal["reconstruct", "segment", "track", "report"]

WRITTEN = (
    CALIBRATION, REFERENCE, CHECKPOINT, "reference.tif", "reference_labels.tif", "motions.h5",
    "residuals.tif", "rebuilt.tif", "rebuilt_labels.tif",
)  # fmt: skip


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
    out : Path, optional
        Where results go; by default ``[output] directory``.
    until : {"reconstruct", "segment", "track", "report"}
        The last stage to do.
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    workplace : Workplace, optional
        Who works: this process unless told otherwise.  The results do not depend on it.

    Raises
    ------
    InputError
        If anything that was given cannot be used; nothing is written then.
    """
    inputs = find_inputs(experiment)
    folder = checked_folder(out if out is not None else experiment.output)
    _check_overwriting(inputs, folder)
    job = RunContext(experiment, inputs, folder, StageCache(folder), progress)
    with at_work(workplace, folder) as job.cluster:
        return _run(job, until)


def _run(job: RunContext, until: Until) -> RunResult:
    """The stages, in their order."""
    experiment = job.experiment
    job.check_pixels(states=until in ("track", "report"))
    motions: dict[str, Motions] = {}
    report = None
    _calibrate(job)
    _reconstruct(job)
    if until != "reconstruct":
        _segment(job)
    if until in ("track", "report"):
        motions = track_states(job)
    if until == "report":
        _export_reference(job)
        for scan, table in zip(job.corrected.states, experiment.tables.states):
            _after(job, scan, table, motions[table.name])
        report = _report(job, motions)
    return RunResult(job.folder, motions, tuple(job.done), tuple(job.reused), report)


# ---------------------------------------------------------------------- the stages
def _calibrate(job: RunContext) -> None:
    """Ask the reference scan about the machine, and correct what it says."""
    if not job.calibrates:
        return
    if job.has("calibrate", job.calibrate_print):
        job.machine = job.read_machine()
    else:
        assert job.scan is not None
        labels = job.given_labels
        machine = calibrate_machine(job.scan, job.inputs.grid, job.tables, labels, job.listener)
        path = job.folder / CALIBRATION
        job.ledger.strike("calibrate")
        write_calibration(path, machine.calibration, machine.hardening)
        job.machine = machine
        job.finish("calibrate", job.calibrate_print, [path])
    if job.scan is not None:
        job.scan = job.machine.apply(job.scan)


def _reconstruct(job: RunContext) -> None:
    if job.has_volume:
        if job.inputs.volume is None:
            job.reused.append("reconstruct")
        return
    grid, settings, listener = job.inputs.grid, job.tables.reconstruct, job.listener("reconstruct")
    if job.cluster is not None:
        job.scan = None  # the workers read it
        assert job.corrected.reference is not None
        result = job.cluster.reconstruct(job.corrected.reference, grid, settings, listener)
    else:
        assert job.scan is not None
        result = reconstruct(job.scan, grid, settings, progress=listener)
    job.scan = None
    job.reference = Reference(result.volume, result.residuals)
    path = job.folder / CHECKPOINT
    job.ledger.strike("reconstruct")
    write_reference(path, job.reference)
    job.finish("reconstruct", job.reconstruct_print, [path])


def _segment(job: RunContext) -> None:
    if job.has("segment", job.segment_print):
        return
    volume = job.volume()
    residuals = job.reference.residuals if job.reference is not None else ()
    if job.given_labels is not None:
        reference = Reference(volume, residuals, job.given_labels, border=border_labels(job.given_labels))
    else:
        found = segment(volume, job.tables.segment, progress=job.listener("segment"))
        labels = np.asarray(found.labels, dtype=np.int32)
        reference = Reference(volume, residuals, labels, found.threshold, tuple(int(b) for b in found.border))
        if not labels.any():
            highest = float(volume.array.max())
            fact = f"no grains found in the volume, whose highest attenuation is {highest:.4g}/mm"
            raise InputError("segment", fact, "lower segment.threshold or the smallest grain, or check the scan")
    job.reference = reference
    path = job.folder / REFERENCE
    grains = job.grains()
    job.ledger.strike("segment")
    write_reference(path, reference, grains)
    job.finish("segment", job.segment_print, [path])
    if job.inputs.volume is None:
        job.ledger.enter("reconstruct", job.reconstruct_print, [path])
        (job.folder / CHECKPOINT).unlink(missing_ok=True)


def _after(job: RunContext, scan: ScanInput, table: StateTable, motions: Motions) -> None:
    """What follows from a state's motions: residual radiographs, the rebuilt sample, exports."""
    folder, upstream = job.folder / table.name, [job.track_prints[table.name]]
    wanted = ["residuals", *(["rebuilt"] if job.tables.output.rebuild else []), *job.tables.output.exports]
    for k, what in enumerate(wanted):
        stage, fingerprint = f"{table.name}/{what}", job.ledger.fingerprint(what, (), upstream)
        if job.has(stage, fingerprint):
            continue
        job.tell(f"{table.name}: {what}", k, len(wanted))
        job.ledger.strike(stage)
        if what == "residuals":
            files = outputs.write_residuals(folder, job.grains(), motions, scan.read()[0], job.tables.track.projector)
        elif what == "rebuilt":
            files = outputs.write_rebuilt(folder, job.grains(), motions, job.inputs.grid)
        else:
            files = outputs.write_export(what, folder, motions, job.labelled())
        job.finish(stage, fingerprint, files)


def _export_reference(job: RunContext) -> None:
    """The reference beside the states' exports."""
    for what in job.tables.output.exports:
        stage, fingerprint = f"reference/{what}", job.ledger.fingerprint(what, (), [job.segment_print])
        if not job.has(stage, fingerprint):
            job.ledger.strike(stage)
            files = outputs.write_reference_export(what, job.folder, job.labelled())
            job.finish(stage, fingerprint, files)


def _report(job: RunContext, motions: dict[str, Motions]) -> Path:
    path = job.folder / "report.html"
    upstream = [job.segment_print, *job.track_prints.values()]
    fingerprint = job.ledger.fingerprint(["report", list(motions)], (), upstream)
    if not job.has("report", fingerprint):
        job.tell("report", 0, 1)
        job.ledger.strike("report")
        facts = job.machine.facts
        outputs.write_report(job.experiment, job.corrected, job.labelled(), motions, job.folder, machine=facts)
        job.finish("report", fingerprint, [path])
    return path


# ---------------------------------------------------------------------- small parts
def _check_overwriting(inputs: Inputs, folder: Path) -> None:
    """Refuse to write results over what was measured."""
    scans = [s for s in (inputs.reference, *inputs.states) if s is not None]
    given = [f for s in scans for f in s.files] + [f for s in (inputs.volume, inputs.labels) if s for f in s.files]
    folders = {folder.resolve(), *(folder.resolve() / s.key.removeprefix("states.") for s in inputs.states)}
    for file in given:
        if file.resolve().parent in folders and file.name in WRITTEN:
            fact = f"{file} is an input and would be overwritten"
            raise InputError("output.directory", fact, "choose another folder for the results")
