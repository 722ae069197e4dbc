"""Fingerprints of a run's stages, hashes of their inputs, so that a stage is repeated only if those changed.

The geometry enters as given, before calibration; the reconstruction's fingerprint includes the calibration's.  The
device is left out, since all give the same results to rounding.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

from grainmotion.calibration.settings import ScannerSettings
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import Inputs
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.tracking.settings import TrackSettings
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.starts import start_of

Settings = DemSettings | ScannerSettings | ReconstructSettings | SegmentSettings | TrackSettings


@dataclass(frozen=True, eq=False)
class Fingerprints:
    """Fingerprints of all stages of one experiment."""

    experiment: Experiment
    inputs: Inputs
    cache: StageCache
    refused: frozenset[str] = frozenset()  # states that are not tracked

    def with_states(self, experiment: Experiment, inputs: Inputs, refused: frozenset[str]) -> Fingerprints:
        """Those of the same experiment with other states: the reference's files are not looked at again."""
        other = Fingerprints(experiment, inputs, self.cache, refused)
        for name in ("calibrate", "reconstruct", "segment"):
            if name in vars(self):
                vars(other)[name] = vars(self)[name]
        return other

    @property
    def calibrates(self) -> bool:
        """Whether the scanner is calibrated on the reference scan: only if there is one to reconstruct."""
        reference = self.inputs.reference
        if self.inputs.volume is not None or reference is None:
            return False
        return self.experiment.tables.calibrate.calibrates(len(reference.geometry))

    @cached_property
    def calibrate(self) -> str:
        """Fingerprint of the scanner's calibration."""
        inputs, grid, tables = self.inputs, self.inputs.grid, self.experiment.tables
        assert inputs.reference is not None
        settings = ["calibrate", _plain(tables.calibrate), grid.shape, grid.voxel_size, grid.center]
        settings.append(inputs.reference.settings)
        files = list(inputs.reference.files)
        if tables.calibrate.hardening:
            settings += [_plain(tables.reconstruct), _plain(tables.segment)]
            files += [] if inputs.labels is None else inputs.labels.files
        return self.cache.fingerprint(settings, files)

    @cached_property
    def reconstruct(self) -> str:
        """Fingerprint of the reference volume."""
        inputs, grid = self.inputs, self.inputs.grid
        grid_numbers = [grid.shape, grid.voxel_size, grid.center]
        if inputs.volume is not None:
            inner = list(inputs.volume.inner)
            seen = [] if inputs.volume_scan is None else [inputs.volume_scan.settings]  # what its scan saw of it
            return self.cache.fingerprint(["volume", grid_numbers, inner, *seen], inputs.volume.files)
        assert inputs.reference is not None
        tables = self.experiment.tables
        settings = ["reconstruct", grid_numbers, _plain(tables.reconstruct), inputs.reference.settings]
        settings += [str(tables.calibrate.beam_level)]
        return self.cache.fingerprint(settings, inputs.reference.files, [self.calibrate] if self.calibrates else [])

    @cached_property
    def segment(self) -> str:
        """Fingerprint of the labels and grains."""
        labels = self.inputs.labels
        if labels is not None:
            settings = ["labels", list(labels.inner)]
            return self.cache.fingerprint(settings, labels.files, [self.reconstruct])
        return self.cache.fingerprint(["segment", _plain(self.experiment.tables.segment)], (), [self.reconstruct])

    @cached_property
    def tracks(self) -> dict[str, str]:
        """Fingerprints of the states' motions, by the state's name."""
        prints: dict[str, str] = {}
        tables = self.experiment.tables
        for k, (scan, table) in enumerate(zip(self.inputs.states, tables.states, strict=True)):
            files, upstream = list(scan.files), [self.segment]
            named = table.initial not in ("previous", "reference")
            settings = ["track", _plain(tables.track), scan.settings, named]
            if named:
                files.append(self.experiment.folder / table.initial)
            elif table.initial == "previous":
                waits = start_of(tables.states, k)
                upstream += ["reference"] if waits is None else [prints[name] for name in waits.after]
                settings += [] if waits is None else [waits.ratio]
            settings += [] if table.initial_about is None else [table.initial_about]
            settings += ["refused"] if table.name in self.refused else []
            prints[table.name] = self.cache.fingerprint(settings, files, upstream)
        return prints

    def after_segmentation(self, name: str) -> str:
        """Fingerprint of an output that depends on the grains alone."""
        return self.cache.fingerprint(name, (), [self.segment])

    def after_tracking(self, name: str, state: str) -> str:
        """Fingerprint of an output that depends on a state's motions."""
        return self.cache.fingerprint(name, (), [self.tracks[state]])

    @cached_property
    def series(self) -> str:
        """Fingerprint of the table of all states."""
        times = [[table.name, table.time] for table in self.experiment.tables.states]
        return self.cache.fingerprint(["series", times], (), self.tracks.values())

    @cached_property
    def dem(self) -> str:
        """Fingerprint of the export into DEM codes, of all states."""
        tables = self.experiment.tables
        settings = ["dem", _plain(tables.dem), [(table.name, table.time) for table in tables.states]]
        return self.cache.fingerprint(settings, (), [self.segment, *self.tracks.values()])

    @cached_property
    def report(self) -> str:
        """Fingerprint of the report on all states."""
        upstream = [self.segment, *self.tracks.values()]
        return self.cache.fingerprint(["report", list(self.tracks)], (), upstream)


def _plain(settings: Settings) -> dict[str, object]:
    """Settings as plain data, without the device."""
    return {key: value for key, value in dataclasses.asdict(settings).items() if key != "device"}
