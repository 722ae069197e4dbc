"""Level of the beam in the views of the reference scan, estimated before anything else is made of the scan."""

from __future__ import annotations

import numpy as np

from grainmotion.calibration.beam_level import BeamLevels, beam_levels
from grainmotion.experiment.beam_level import finding, levels_wanted
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.beam_level_json import read_beam_levels, write_beam_levels
from grainmotion.workflow.context import RunContext, load_result

BEAM_LEVEL = "beam_level.json"


def level_reference(context: RunContext) -> None:
    """Estimate the beam's levels of the reference scan, or read them, and correct the scan from here on."""
    source = context.inputs.reference
    if source is None or not levels_wanted(context.tables, source):
        return
    levels = _levels(context, source)
    if levels.source != "none":
        context.level(source, levels.levels)
        context.add([finding(levels, source)])


def _levels(context: RunContext, source: ScanInput) -> BeamLevels:
    """The levels, from their file if an earlier run made it of the same input."""
    grid, settings, path = context.inputs.grid, context.tables.reconstruct, context.folder / BEAM_LEVEL
    made_from = ["beam level", grid.shape, grid.voxel_size, grid.center, source.settings]
    made_from += [settings.projector, settings.non_negative, settings.circular]
    fingerprint = context.cache.fingerprint(made_from, source.files)
    if context.cache.is_done("beam level", fingerprint):
        constant = BeamLevels(np.zeros(len(source.geometry)))
        return load_result(read_beam_levels, path) if context.cache.files("beam level") else constant
    context.notify("level of the beam")
    levels = beam_levels(context.measured(source), grid, settings)
    context.cache.discard("beam level")
    files = [path] if levels.source != "none" else []  # a constant beam leaves no file
    if files:
        write_beam_levels(path, levels)
    context.cache.add("beam level", fingerprint, files)
    return levels
