"""Motions from files from which states start, once volume and labels of the reference are known."""

from __future__ import annotations

from collections.abc import Callable

from grainmotion.io.spam import read_ddic_tsv
from grainmotion.model.motions import Motions
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.reference_stages import SegmentedReference


def given_start(context: RunContext, reference: Callable[[], SegmentedReference], index: int) -> Motions | None:
    """The motions in the file that a state names as its start; None if it names another state.

    A file of spam is in voxels of the reference volume, which may have grown, and about the bounding boxes of the
    labels, which are those given, specks included, or else those of the segmentation.
    """
    table, start = context.tables.states[index], context.inputs.starts[index]
    if start is None or not table.initial.endswith(".tsv"):
        return start
    stored, given = reference().stored, context.given_labels
    labels = stored.labels if given is None else given
    return read_ddic_tsv(context.experiment.folder / table.initial, stored.volume, labels, about=table.initial_about)
