"""The stage that writes grains as rigid bodies for DEM codes, from the reference and the motions of all states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from grainmotion.grain_shapes.poses import State
from grainmotion.grain_shapes.rigid_body import rigid_bodies
from grainmotion.io.dem_folder import write_dem_folder
from grainmotion.model.progress import prefixed
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.provenance import Stage
from grainmotion.workflow.reference_stages import SegmentedReference
from grainmotion.workflow.tracking_stage import TrackedState

DEM = "dem"


def export_dem(
    context: RunContext, reference: Callable[[], SegmentedReference], tracked: Mapping[str, TrackedState]
) -> None:
    """Write the folder ``dem`` unless grains, motions and settings are those of the last one."""
    folder, settings = context.folder / DEM, context.tables.dem
    files: list[Path] = []  # filled when they are written: how many there are depends on the grains

    def write(_: None) -> None:
        grains = reference().grains
        states = [State(table.name, tracked[table.name].motions, table.time) for table, _ in context.states]
        progress, bodies = prefixed(context.progress, DEM), rigid_bodies(grains, settings)
        files[:] = write_dem_folder(folder, bodies, states, settings, progress=progress, count=len(grains))

    run = partial(context.notify, DEM)
    context.complete(Stage(DEM, context.fingerprints.dem, files, run=run, write=write, load=lambda: None))
