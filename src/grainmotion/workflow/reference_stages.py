"""Reconstruction and segmentation of the reference as stages of a run."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from grainmotion.diagnosis.labels import grains_in_doubt
from grainmotion.io.results import StoredReference, read_reference, write_reference
from grainmotion.model.finding import Finding, Level
from grainmotion.model.grains import GrainSet
from grainmotion.model.progress import begin, prefixed
from grainmotion.reconstruction.grid_growth import GROWN_REMEDY
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.border import cut_labels
from grainmotion.segmentation.extraction import extract_grains
from grainmotion.segmentation.grain_cutting import Cut, cut_grains
from grainmotion.segmentation.labels import CleanLabels
from grainmotion.segmentation.segment import Segmentation, segment
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.workflow.calibration_stage import corrected_source
from grainmotion.workflow.checks import Findings, findings_once
from grainmotion.workflow.context import RunContext, load_result
from grainmotion.workflow.memory import give_back_memory
from grainmotion.workflow.provenance import Stage

CHECKPOINT = "reconstruction.h5"  # the volume until it is segmented; then REFERENCE holds volume and labels
REFERENCE = "reference.h5"
CHECKS_OF_GRID = "checks-grid.json"
MAX_KEPT_VOLUME = 1 << 26
"""Bytes of a volume up to which it stays in memory while grains are tracked."""


@dataclass(eq=False)
class SegmentedReference:
    """A reference volume with its labels, and its grains, extracted on first use.

    Volume and labels are read again from ``file`` when they are next asked for after they were `released`.
    """

    file: Path
    settings: SegmentSettings
    cut: Cut = cut_grains

    @cached_property
    def stored(self) -> StoredReference:
        """Volume and labels."""
        begin("segment: reading the volume and its labels")
        return load_result(read_reference, self.file)

    def released(self) -> SegmentedReference:
        """The same without a large volume and its labels: while grains are tracked they have their own voxels."""
        _ = self.grains, self.doubts, self.residuals
        if "stored" in self.__dict__ and self.stored.volume.array.nbytes > MAX_KEPT_VOLUME:
            del self.__dict__["stored"]
            give_back_memory()
        return self

    @cached_property
    def residuals(self) -> tuple[float, ...]:
        """Relative residuals of the reconstruction."""
        return self.stored.residuals

    @cached_property
    def grains(self) -> GrainSet:
        """The grains that are tracked."""
        stored = self.stored
        assert stored.labels is not None
        begin("segment: cutting the grains")
        segmentation = Segmentation(stored.labels, stored.threshold, stored.border)
        return extract_grains(stored.volume, segmentation, self.settings, cut=self.cut)

    @cached_property
    def doubts(self) -> dict[int, str]:
        """Of given labels that hold more than one grain, the reason not to trust their motions."""
        assert self.stored.labels is not None
        return grains_in_doubt(self.stored.labels) if np.isnan(self.stored.threshold) else {}


def reconstruct_stage(context: RunContext) -> Callable[[], StoredReference]:
    """Reconstruct the reference, or take the volume that was given."""
    if context.inputs.volume is not None:
        return lambda: StoredReference(context.given_volume)
    fingerprint = context.fingerprints.reconstruct
    if context.cache.is_done("check grid", fingerprint):  # what an earlier run told is told again
        context.add(_kept_grid_findings(context, lambda: ()))
    return context.complete(
        Stage(
            "reconstruct",
            fingerprint,
            [context.folder / CHECKPOINT],
            run=functools.partial(_reconstruct, context),
            write=functools.partial(write_reference, context.folder / CHECKPOINT),
            load=lambda: load_result(read_reference, context.cache.files("reconstruct")[0]),
        )
    )


def segment_stage(context: RunContext, reference: Callable[[], StoredReference]) -> Callable[[], SegmentedReference]:
    """Segment the reference volume, or take the labels that were given, and extract the grains."""
    settings, path = context.tables.segment, context.folder / REFERENCE
    cut = cut_grains if context.cluster is None else context.cluster.cut

    def run() -> SegmentedReference:
        stored = reference()
        if context.given_labels is not None:
            segmentation = Segmentation.of(CleanLabels.of(context.given_labels).labels)
            segmentation = replace(segmentation, border=cut_labels(segmentation.labels, stored.volume))
        else:
            segmentation = segment(stored.volume, settings, progress=prefixed(context.progress, "segment"))
        labels, threshold, border = segmentation.labels, segmentation.threshold, segmentation.border
        stored = StoredReference(stored.volume, stored.residuals, labels, threshold, border, phases=segmentation.phases)
        segmented = SegmentedReference(path, settings, cut)
        segmented.stored = stored
        scene = segmented.grains.scene  # extracted now: if that fails, the old result is kept
        segmented.stored = replace(segmented.stored, scene=scene)
        return segmented

    def write(segmented: SegmentedReference) -> None:
        context.notify("segment: writing the volume and its labels")
        write_reference(path, segmented.stored, segmented.grains, asdict(context.experiment.reference_settings))
        if context.inputs.volume is None:
            context.cache.add("reconstruct", context.fingerprints.reconstruct, [path])
            (context.folder / CHECKPOINT).unlink(missing_ok=True)

    def load() -> SegmentedReference:
        return SegmentedReference(path, settings, cut)

    return context.complete(Stage("segment", context.fingerprints.segment, [path], run, write, load))


def _reconstruct(context: RunContext) -> StoredReference:
    source, grid, settings = context.inputs.reference, context.inputs.grid, context.tables.reconstruct
    assert source is not None
    progress = prefixed(context.progress, "reconstruct")
    context.notify("reconstruct")
    if context.inputs.labels is not None:  # they are on this grid
        settings = replace(settings, outline="grid")
    if context.tables.calibrate.hardening:  # the scan is linearised by another curve
        settings = replace(settings, hardening=False)
    if context.cluster is not None:
        context.forget(source)  # the workers read it
        result = context.cluster.reconstruct(corrected_source(source, context.scanner()), grid, settings, progress)
    else:
        result = reconstruct(context.radiographs(source), grid, settings, progress=progress)
        context.forget(source)
    found = tuple(Finding(Level.NOTE, "field-of-view", "reference", n, remedy=GROWN_REMEDY) for n in result.notes)
    context.add(_kept_grid_findings(context, lambda: found))
    return StoredReference(result.volume, result.residuals)


def _kept_grid_findings(context: RunContext, check: Callable[[], Findings]) -> Findings:
    """What was noticed of the grid when the volume was reconstructed, from its file if an earlier run did that."""
    path = context.folder / CHECKS_OF_GRID
    return findings_once(context, "check grid", path, context.fingerprints.reconstruct, check)
