"""Mechanics as outputs of a run: strains, contacts, fabric and void ratios of the reference and of each state."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from functools import partial

from grainmotion.io.mechanics_files import mechanics_names, write_mechanics
from grainmotion.mechanics.contacts import Contacts, contacts
from grainmotion.mechanics.state_mechanics import reference_mechanics, state_mechanics
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.provenance import Stage
from grainmotion.workflow.reference_stages import SegmentedReference
from grainmotion.workflow.tracking_stage import TrackedState

MECHANICS = "mechanics"
REFERENCE_PREFIX = "reference_"
"""Before the names of the files of the reference, which are in the folder of the results itself."""


def write_mechanics_files(
    context: RunContext, reference: Callable[[], SegmentedReference], tracked: Mapping[str, TrackedState]
) -> None:
    """Write the mechanics of the reference and of each state, unless that is done."""
    settings, prints = context.tables.mechanics, context.fingerprints
    made_by = f"{MECHANICS} {settings}"

    @functools.cache
    def before() -> Contacts:
        return contacts(reference().grains, tolerance=settings.tolerance)

    def write_reference() -> None:
        found = reference_mechanics(reference().grains, reference().stored.volume, settings)
        write_mechanics(context.folder, found, settings, prefix=REFERENCE_PREFIX)

    names = mechanics_names(REFERENCE_PREFIX, state=False)
    _complete(context, f"reference/{MECHANICS}", prints.after_segmentation(made_by), "", names, write_reference)
    for table, _ in context.states:

        def write_state(name: str = table.name) -> None:
            grains, grid, motions = reference().grains, reference().stored.volume, tracked[name].motions
            write_mechanics(context.folder / name, state_mechanics(grains, grid, motions, before(), settings), settings)

        print_ = prints.after_tracking(made_by, table.name)
        _complete(context, f"{table.name}/{MECHANICS}", print_, table.name, mechanics_names(state=True), write_state)


def _complete(
    context: RunContext, name: str, fingerprint: str, folder: str, names: tuple[str, ...], write: Callable[[], None]
) -> None:
    files = [context.folder / folder / file for file in names]
    run = partial(context.notify, name.replace("/", ": "))
    context.complete(Stage(name, fingerprint, files, run=run, write=lambda _: write(), load=lambda: None))
