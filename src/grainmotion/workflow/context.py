"""One run under way: its inputs, its ledger, and what was read or made so far."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Progress
from grainmotion.backends.device import Device
from grainmotion.cluster.connection import ClusterConnection
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment, ExperimentFile
from grainmotion.experiment.inputs import Inputs, check_contrast
from grainmotion.io.calibration_json import read_calibration
from grainmotion.io.results import Reference, read_reference
from grainmotion.io.stacks import Stack
from grainmotion.model.grains import GrainSet
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.flat_field import PixelReport
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.label_refinement import fine_grains
from grainmotion.workflow.calibration_stage import ScannerCalibration
from grainmotion.workflow.provenance import StageCache

CHECKPOINT = "reconstruction.h5"  # the volume until its grains are found; then both are in REFERENCE
REFERENCE = "reference.h5"
CALIBRATION = "calibration.json"
ENOUGH_VIEWS = 60  # of a full scan: half of fewer contradicts the other half on any machine
T = TypeVar("T")


@dataclass(eq=False)
class RunContext:
    """One run under way."""

    experiment: Experiment
    inputs: Inputs
    folder: Path
    ledger: StageCache
    progress: Progress | None
    done: list[str] = field(default_factory=list)
    reused: list[str] = field(default_factory=list)
    scan: Scan | None = None
    reference: Reference | None = None
    grain_set: GrainSet | None = None
    given_labels: NDArray[np.int32] | None = None
    machine: ScannerCalibration = field(default_factory=ScannerCalibration)
    cluster: ClusterConnection | None = None

    @property
    def tables(self) -> ExperimentFile:
        """All tables of the experiment file."""
        return self.experiment.tables

    @property
    def calibrates(self) -> bool:
        """Whether the reference scan is asked about the machine."""
        wanted, reference = self.tables.calibrate, self.inputs.reference
        if self.inputs.volume is not None or reference is None:
            return False
        enough = wanted.geometry != "auto" or len(reference.geometry) >= ENOUGH_VIEWS
        return bool((wanted.geometry and enough) or wanted.hardening)

    @cached_property
    def walkers(self) -> Device | None:
        """Where grains are walked, if the settings do not say."""
        return None if self.cluster is None else self.cluster.crew

    @cached_property
    def calibrate_print(self) -> str:
        """Fingerprint of what was found of the machine."""
        inputs, grid, wanted = self.inputs, self.inputs.grid, self.tables.calibrate
        assert inputs.reference is not None
        made = ["calibrate", wanted.model_dump(), grid.shape, grid.voxel_size, grid.center, inputs.reference.settings]
        files = list(inputs.reference.files)
        if wanted.hardening:
            made += [_plain(self.tables.reconstruct), _plain(self.tables.segment)]
            files += [] if inputs.labels is None else inputs.labels.files
        return self.ledger.fingerprint(made, files)

    @cached_property
    def reconstruct_print(self) -> str:
        """Fingerprint of the reference volume."""
        inputs, grid = self.inputs, self.inputs.grid
        place = [grid.shape, grid.voxel_size, grid.center]
        if inputs.volume is not None:
            inner = [p.inner for p in inputs.volume.parts]
            return self.ledger.fingerprint(["volume", place, inner], inputs.volume.files)
        assert inputs.reference is not None
        made = ["reconstruct", place, _plain(self.tables.reconstruct), inputs.reference.settings]
        upstream = [self.calibrate_print] if self.calibrates else []
        return self.ledger.fingerprint(made, inputs.reference.files, upstream)

    @cached_property
    def segment_print(self) -> str:
        """Fingerprint of the grains."""
        labels = self.inputs.labels
        if labels is not None:
            made: list[Any] = ["labels", [p.inner for p in labels.parts]]
            return self.ledger.fingerprint(made, labels.files, [self.reconstruct_print])
        return self.ledger.fingerprint(["segment", _plain(self.tables.segment)], (), [self.reconstruct_print])

    @cached_property
    def track_prints(self) -> dict[str, str]:
        """Fingerprint of each state's motions, by name."""
        prints: dict[str, str] = {}
        previous = "reference"
        for scan, table in zip(self.inputs.states, self.tables.states):
            files, upstream = list(scan.files), [self.segment_print]
            named = table.initial not in ("previous", "reference")
            if named:
                files.append(self.experiment.folder / table.initial)
            elif table.initial == "previous":
                upstream.append(previous)
            made = ["track", _plain(self.tables.track), scan.settings, named]
            previous = prints[table.name] = self.ledger.fingerprint(made, files, upstream)
        return prints

    @property
    def has_grains(self) -> bool:
        """Whether the grains are there, and so the volume."""
        return self.ledger.is_done("segment", self.segment_print)

    @property
    def has_machine(self) -> bool:
        """Whether the machine need not be calibrated."""
        return not self.calibrates or self.ledger.is_done("calibrate", self.calibrate_print)

    @property
    def has_volume(self) -> bool:
        """Whether the reference volume need not be reconstructed."""
        given = self.inputs.volume is not None
        return given or self.has_grains or self.ledger.is_done("reconstruct", self.reconstruct_print)

    def check_pixels(self, states: bool) -> None:
        """Read all that is still to be used, so that bad pixels are known before anything is written."""
        if not (self.has_volume and self.has_machine) and self.inputs.reference is not None:
            self.tell("reading the reference scan", 0, 1)
            self.scan, pixels = self.inputs.reference.read()
            self.tell_pixels("reference", pixels)
            check_contrast(f"{self.inputs.reference.radiographs.spec} (reference.radiographs)", self.scan)
        if not (self.has_grains and self.has_machine):
            if self.inputs.volume is not None:
                self.volume()
            if self.inputs.labels is not None:
                self.given_labels = _given_labels(self.inputs.labels)
        if not states:
            return
        for k, (scan, table) in enumerate(zip(self.inputs.states, self.tables.states)):
            if not self.ledger.is_done(f"{table.name}/track", self.track_prints[table.name]):
                self.tell("checking the radiographs", k, len(self.inputs.states))
                self.tell_pixels(table.name, scan.read()[1])

    def tell_pixels(self, name: str, pixels: PixelReport) -> None:
        """Say how many pixels are masked, if any."""
        if pixels.bad:
            self.tell(f"{name}: {pixels}", 1, 1)

    def tell(self, message: str, done: int, total: int) -> None:
        """Report progress, if anybody listens."""
        if self.progress is not None:
            self.progress(message, done, total)

    def listener(self, prefix: str) -> Progress:
        """A verb's progress, with the stage's name before it."""
        return lambda message, done, total: self.tell(f"{prefix}: {message}", done, total)

    def read_machine(self) -> ScannerCalibration:
        """What an earlier run found of the machine."""
        told = self.inputs.reference
        assert told is not None
        return ScannerCalibration(*kept(lambda path: read_calibration(path, told.geometry), self.folder / CALIBRATION))

    @cached_property
    def corrected(self) -> Inputs:
        """The inputs as they are to be used, once the machine is known; fingerprints are of what was told."""
        return self.machine.correct(self.inputs) if self.calibrates else self.inputs

    def volume(self) -> Volume:
        """The reference volume, as a reconstruction or as given."""
        if self.reference is None and self.inputs.volume is not None:
            array = self.inputs.volume.read()
            try:
                volume = Volume(array.astype(np.float32), self.inputs.grid.voxel_size, self.inputs.grid.center)
            except InputError as error:
                raise InputError(f"{self.inputs.volume.spec} (reference.volume)", error.fact, error.remedy) from error
            self.reference = Reference(volume)
        if self.reference is None:
            self.reference = kept(read_reference, self.ledger.files("reconstruct")[0])
        return self.reference.volume

    def labelled(self) -> Reference:
        """The reference with its labels, read when they are first asked for."""
        if self.reference is None or self.reference.labels is None:
            self.reference = kept(read_reference, self.folder / REFERENCE)
        return self.reference

    def grains(self) -> GrainSet:
        """The grains, cut out when they are first asked for."""
        if self.grain_set is None:
            reference = self.labelled()
            assert reference.labels is not None
            settings = self.tables.segment
            self.grain_set = grains_from_labels(
                reference.volume,
                reference.labels,
                reach=settings.reach,
                border=reference.border,
                background=settings.background,
                finer=settings.finer,
                cut=fine_grains if self.cluster is None else self.cluster.cut,
            )
        return self.grain_set

    def finish(self, stage: str, fingerprint: str, files: list[Path]) -> None:
        """Enter a stage whose files are in place."""
        self.ledger.enter(stage, fingerprint, files)
        self.done.append(stage)

    def has(self, stage: str, fingerprint: str) -> bool:
        """Whether a stage is there already; if so, it is noted."""
        there = self.ledger.is_done(stage, fingerprint)
        if there:
            self.reused.append(stage)
        return there


def kept(read: Callable[[Path], T], path: Path) -> T:
    """What an earlier run left in a file."""
    try:
        return read(path)
    except InputError as error:
        raise InputError(error.where, error.fact, "delete it; the same command makes it again") from error


def _given_labels(stack: Stack) -> NDArray[np.int32]:
    where = f"{stack.spec} (reference.labels)"
    labels = stack.read()
    if not np.isfinite(labels).all() or (labels < 0).any() or (labels != np.round(labels)).any():
        raise InputError(where, "labels are not whole numbers >= 0", "give 0 for no grain, 1, 2, ... for grains")
    if labels.max(initial=0) > np.iinfo(np.int32).max:
        raise InputError(where, f"a label of {labels.max()}", "number the grains from 1")
    if not labels.any():
        raise InputError(where, "no grains found: all labels are 0", "give 1, 2, ... where grains are")
    return labels.astype(np.int32)


def _plain(settings: Any) -> dict[str, Any]:
    """Settings for a fingerprint, but for the device: any gives the same results to rounding."""
    return {key: value for key, value in dataclasses.asdict(settings).items() if key != "device"}
