"""Checks of a run on what other software made: the reference volume, labels, and motions to start from.

They are made once of each input, before anything is computed from it; `checks` says how findings are kept.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.grain_shapes import check_grain_shapes
from grainmotion.diagnosis.hardening import check_hardening, corrected_hardening
from grainmotion.diagnosis.start_file import check_start
from grainmotion.diagnosis.unlabelled import check_fragments, check_grain_sizes, check_unlabelled
from grainmotion.experiment.given_inputs import given_label_findings, given_volume_findings
from grainmotion.model.finding import Finding, Level
from grainmotion.model.progress import detail
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.volume import Volume
from grainmotion.workflow.checks import findings_once, settle
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.given_starts import given_start
from grainmotion.workflow.reference_stages import SegmentedReference

CHECKS_OF_VOLUME = "checks-volume.json"
CHECKS_OF_GRAINS = "checks-grains.json"
MAX_SHARED_VOXELS = 1 << 28
"""Voxels of a volume up to which workers share its checks: one that makes a check holds the volume and its labels."""

Check = Callable[[], tuple[Finding, ...]]


def check_given(context: RunContext) -> None:
    """Check a volume made by other software, against radiographs of the reference or of the first state."""
    inputs = context.inputs
    volume, source = inputs.volume, inputs.volume_scan or next(iter(inputs.states), None)
    if volume is None or source is None:
        return
    grid = inputs.grid
    files = [*volume.files, *source.files]
    settings = ["check volume", grid.shape, grid.voxel_size, grid.center, source.settings]
    fingerprint = context.cache.fingerprint(settings, files)

    def check() -> tuple[Finding, ...]:
        context.notify("checking the volume")
        later = None if source is inputs.volume_scan else context.measured(source)
        return given_volume_findings(inputs, context.given_volume, later)

    path = context.folder / CHECKS_OF_VOLUME
    settle(context, source, findings_once(context, "check volume", path, fingerprint, check))


def check_grains(context: RunContext, reference: Callable[[], SegmentedReference]) -> None:
    """Check labels, what they leave out, beam hardening, and motions from files that states start from."""
    inputs = context.inputs
    source = inputs.reference or next(iter(inputs.states), None)
    if source is None:
        return
    named = [k for k, start in enumerate(inputs.starts) if start is not None]
    files = [context.experiment.folder / context.tables.states[k].initial for k in named]
    settings = ["check grains", *(context.tables.states[k].initial_about or "" for k in named)]
    fingerprint = context.cache.fingerprint(settings, files, [context.fingerprints.segment])

    def check() -> tuple[Finding, ...]:
        context.notify("checking the grains")
        detail("what has no label", 0, 3)
        stored = reference().stored
        assert stored.labels is not None
        found, checks = list[Finding](), list[Check]()
        if context.read_labels is not None:
            found += given_label_findings(inputs, stored.volume, context.read_labels)
        if not any(f.level is Level.ERROR for f in found):
            pixels = None if inputs.reference is None else f"{source.key}.geometry.pixel_size"
            checks.append(partial(_label_findings, stored.volume, stored.labels, stored.threshold, pixels))
        if inputs.reference is not None and inputs.volume is None:
            scan = stored.volume.hardening.apply(context.some_views(inputs.reference))
            checks.append(partial(_beam_findings, scan, stored.volume, stored.labels, inputs.reference.key))
        shared = stored.volume.array.size <= MAX_SHARED_VOXELS
        for findings in each(_made, checks) if shared else map(_made, checks):
            found += findings
        for k in named:
            start = given_start(context, reference, k)
            assert start is not None
            where = f"{context.tables.states[k].initial} ({inputs.states[k].key}.initial)"
            found += check_start(start, reference().grains, inputs.grid, where)
        return tuple(found)

    path = context.folder / CHECKS_OF_GRAINS
    settle(context, source, findings_once(context, "check grains", path, fingerprint, check))


def _made(check: Check) -> tuple[Finding, ...]:
    return check()


def _label_findings(
    volume: Volume, labels: NDArray[np.integer], threshold: float, pixels: str | None
) -> tuple[Finding, ...]:
    """What labels leave out, and their sizes and shapes; ``pixels`` is the key of their edge, if a scan tells it."""
    found = check_fragments(volume, labels, threshold) or check_unlabelled(volume, labels)
    detail("sizes and shapes", 1, 3)
    found = (*found, *check_grain_sizes(labels))
    return found if pixels is None else (*found, *check_grain_shapes(labels, pixels))


def _beam_findings(scan: Scan, volume: Volume, labels: NDArray[np.integer], where: str) -> tuple[Finding, ...]:
    """Beam hardening that was corrected, and what is left of it."""
    detail("beam hardening", 2, 3)
    return (*corrected_hardening(volume.hardening, where), *check_hardening(scan, volume, labels, where))
