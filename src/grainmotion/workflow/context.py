"""State of a run: its inputs, its finished stages, and the radiographs, each read once."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Index, Progress
from grainmotion.backends.base import PatchBackend
from grainmotion.calibration.scanner import ScannerCalibration
from grainmotion.cluster.connection import ClusterConnection
from grainmotion.diagnosis.hardening import HARDENING_VIEWS
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment, ExperimentFile
from grainmotion.experiment.given_inputs import GivenLabels, read_given_labels, seen_given_volume
from grainmotion.experiment.inputs import Inputs, check_contrast
from grainmotion.experiment.inspection import scan_facts, scan_findings
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.model.finding import Finding, Level
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.workflow.fingerprints import Fingerprints
from grainmotion.workflow.log import PACKAGE_LOG, STAGE_LOG, timed
from grainmotion.workflow.memory import give_back_memory
from grainmotion.workflow.provenance import Stage, StageCache

LOG_LEVELS = {Level.NOTE: logging.INFO, Level.WARNING: logging.WARNING, Level.ERROR: logging.ERROR}
T = TypeVar("T")
WatchedInput = tuple[StateTable, ScanInput, Motions | None]
"""A state, its scan, and the motions in the file that it names as its start."""


@dataclass(eq=False)
class RunContext:
    """State of a run; ``scanner`` returns the calibration, which corrects all scans, once its stage is done."""

    experiment: Experiment
    inputs: Inputs
    folder: Path
    cache: StageCache
    progress: Progress | None = None
    cluster: ClusterConnection | None = None
    scanner: Callable[[], ScannerCalibration] = ScannerCalibration
    done: list[str] = field(default_factory=list)
    reused: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    refused: dict[str, Finding] = field(default_factory=dict)  # states that are not tracked, and why
    as_read: dict[str, tuple[Finding, ...]] = field(default_factory=dict)  # findings of scans, by their key
    _measured: dict[str, Scan] = field(default_factory=dict)
    _corrected: dict[str, Scan] = field(default_factory=dict)
    _some_views: Scan | None = None  # of the reference, kept when it is dropped

    @property
    def tables(self) -> ExperimentFile:
        """All tables of the experiment file."""
        return self.experiment.tables

    @property
    def states(self) -> list[tuple[StateTable, ScanInput]]:
        """The later states, in loading order."""
        return list(zip(self.tables.states, self.inputs.states, strict=True))

    def add(self, findings: Iterable[Finding]) -> None:
        """Record findings, and log them as they come."""
        for finding in findings:
            if finding not in self.findings:
                self.findings.append(finding)
                PACKAGE_LOG.log(LOG_LEVELS[finding.level], finding.line, extra={"finding": finding})

    def findings_on(self, key: str) -> tuple[Finding, ...]:
        """Findings about one scan, such as ``states.NAME``: about its key or a key below it."""
        return tuple(f for f in self.findings if f.where == key or f.where.startswith(f"{key}."))

    def apply_fix(self, source: ScanInput, fix: str) -> None:
        """Undo a mistake in the geometry of a scan, from here on."""
        fixed, inputs = source.fixed(fix), self.inputs
        states = tuple(fixed if s is source else s for s in inputs.states)
        self.inputs = replace(
            inputs, reference=fixed if source is inputs.reference else inputs.reference, states=states
        )
        self.forget(source)
        self.__dict__.pop("fingerprints", None)

    def level(self, reference: ScanInput, levels: Float) -> None:
        """Subtract the beam's levels from the views of the reference scan, from here on and where it is read again."""
        self.inputs = replace(self.inputs, reference=replace(reference, levels=levels))
        if reference.key in self._measured:
            self._measured[reference.key] = self._measured[reference.key].levelled(levels)

    def refuse(self, state: str, finding: Finding) -> None:
        """Do not track a state, because of a finding."""
        self.refused[state] = finding
        self.__dict__.pop("fingerprints", None)

    def set_states(self, states: Sequence[WatchedInput]) -> None:
        """Replace the later states, for a run to which states come as they arrive; what is known of others is kept."""
        self.experiment = self.experiment.with_states([table for table, _, _ in states])
        scans, starts = tuple(scan for _, scan, _ in states), tuple(start for _, _, start in states)
        self.inputs = replace(self.inputs, states=scans, starts=starts)
        before = self.__dict__.pop("fingerprints", None)
        if before is not None:
            refused = frozenset(self.refused)
            self.__dict__["fingerprints"] = before.with_states(self.experiment, self.inputs, refused)

    def drop_state(self, name: str) -> None:
        """Forget what was noticed of a state, before it is read again from changed files."""
        key = f"states.{name}"
        gone = self.findings_on(key)
        self.findings = [finding for finding in self.findings if finding not in gone]
        self.refused.pop(name, None)
        for kept in (self.as_read, self._measured, self._corrected):
            kept.pop(key, None)

    @cached_property
    def fingerprints(self) -> Fingerprints:
        """Fingerprints of all stages."""
        return Fingerprints(self.experiment, self.inputs, self.cache, frozenset(self.refused))

    @cached_property
    def given_volume(self) -> Volume:
        """The reference volume made by other software."""
        assert self.inputs.volume is not None
        return seen_given_volume(self.inputs)

    @property
    def given_labels(self) -> NDArray[np.int32] | None:
        """The labels made by other software, if any are given."""
        return None if self.read_labels is None else self.read_labels.array

    @cached_property
    def read_labels(self) -> GivenLabels | None:
        """The same, with what was noticed when they were read."""
        return None if self.inputs.labels is None else read_given_labels(self.inputs.labels)

    @cached_property
    def tracking_backend(self) -> PatchBackend | None:
        """The workers, if there are any; None for the device of the settings."""
        return None if self.cluster is None else self.cluster.backend

    def notify(self, message: str, done: int = 0, total: int = 1) -> None:
        """Report progress, if there is a listener."""
        if self.progress is not None:
            self.progress(message, done, total)

    def complete(self, stage: Stage[T]) -> Callable[[], T]:
        """Run a stage unless it is done; returns a function that gives its result, read from its files if it was."""
        if self.cache.is_done(stage.name, stage.fingerprint):
            self.reused.append(stage.name)
            STAGE_LOG.info("kept: %s", stage.name)
            return functools.cache(stage.load)
        with timed(stage.name):
            result = stage.run()
            self.cache.discard(stage.name)
            stage.write(result)
            self.cache.add(stage.name, stage.fingerprint, stage.files)
        give_back_memory()
        STAGE_LOG.info("wrote: %s", ", ".join(str(file.relative_to(self.folder)) for file in stage.files))
        self.done.append(stage.name)
        return lambda: result

    def measured(self, source: ScanInput) -> Scan:
        """A scan as measured; what was noticed when it was read is in ``as_read``."""
        if source.key not in self._measured:
            scan, pixels, found = source.read_checked()
            facts = scan_facts(source, scan, pixels, self.inputs.grid)
            self._measured[source.key] = scan
            self.as_read[source.key] = (*found, *scan_findings(source, facts, self.inputs.grid))
        return self._measured[source.key]

    def radiographs(self, source: ScanInput) -> Scan:
        """A scan corrected by the scanner's calibration."""
        if source.key not in self._corrected:
            self._corrected[source.key] = self.scanner().apply(self.measured(source))
            del self._measured[source.key]
        return self._corrected[source.key]

    def forget(self, source: ScanInput) -> None:
        """Drop a scan that is no longer needed, but for some views of the reference."""
        self._measured.pop(source.key, None)
        scan = self._corrected.pop(source.key, None)
        if scan is not None and source is self.inputs.reference:
            self._some_views = scan.select(_evenly(len(scan)))

    def some_views(self, reference: ScanInput) -> Scan:
        """`HARDENING_VIEWS` of the reference scan, evenly spaced and corrected, read again only if they have to be."""
        if self._some_views is None:
            some = reference.select(_evenly(len(reference.geometry)))
            self._some_views = self.scanner().apply(some.read()[0])
        return self._some_views


def _evenly(count: int) -> Index:
    """Indices of some of so many views, evenly spaced."""
    return np.unique(np.arange(HARDENING_VIEWS) * count // HARDENING_VIEWS)


def load_result(read: Callable[[Path], T], path: Path) -> T:
    """Read a result of an earlier run; an error says how to make it again."""
    try:
        return read(path)
    except InputError as error:
        raise InputError(error.where, error.fact, "delete it; the same command makes it again") from error


def check_inputs(context: RunContext, *, states: bool) -> None:
    """Read the inputs of all stages that are not done, so that errors are raised before anything is written."""
    context.notify("comparing the input files with those of the last run")
    prints, inputs, is_done = context.fingerprints, context.inputs, context.cache.is_done
    has_scanner = not prints.calibrates or is_done("calibrate", prints.calibrate)
    has_grains = is_done("segment", prints.segment)
    has_volume = inputs.volume is not None or has_grains or is_done("reconstruct", prints.reconstruct)
    if inputs.reference is not None and not (has_volume and has_scanner):
        context.notify("reading the reference scan")
        scan = context.measured(inputs.reference)
        check_contrast(f"{inputs.reference.radiographs.spec} (reference.radiographs)", scan)
    if not (has_grains and has_scanner):
        _ = context.given_labels, inputs.volume is not None and context.given_volume
    for k, (table, source) in enumerate(context.states if states else []):
        if not is_done(f"{table.name}/track", prints.tracks[table.name]):
            context.notify("checking the radiographs", k, len(context.states))
            context.measured(source)
