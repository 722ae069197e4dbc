"""Level of the beam in the views of the reference scan, estimated before anything else is made of the scan."""

from __future__ import annotations

import numpy as np

from grainmotion.calibration.beam_level import MIN_LEVEL_VIEWS, BeamLevels, beam_levels
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.beam_level_json import read_beam_levels, write_beam_levels
from grainmotion.model.finding import Finding, Level
from grainmotion.workflow.context import RunContext, load_result

BEAM_LEVEL = "beam_level.json"
UNSTEADY_BEAM = 0.02
"""Root mean square of the levels from which the finding is a warning."""


STEADY_SHARE = 0.2
"""Standard deviation of the levels over their mean, below which the flats differ and not the views."""


def level_reference(context: RunContext) -> None:
    """Estimate the beam's levels of the reference scan, or read them, and correct the scan from here on."""
    source = context.inputs.reference
    asked = context.tables.calibrate.beam_level == "auto"
    if source is None or not asked or source.air is not None or len(source.geometry) < MIN_LEVEL_VIEWS:
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
    levels = beam_levels(context.measured(source), grid, settings)
    context.cache.discard("beam level")
    files = [path] if levels.source != "none" else []  # a constant beam leaves no file
    if files:
        write_beam_levels(path, levels)
    context.cache.add("beam level", fingerprint, files)
    return levels


def finding(levels: BeamLevels, source: ScanInput) -> Finding:
    """What was found and done, in words."""
    monitored = (
        "" if source.monitor is None else ", although counts were divided by the beam monitor, which seems wrong"
    )
    origin = {"air": "the air beside the sample", "reconstruction": "the reconstruction, as no air is in view"}
    corrected = f"each view was corrected by one factor, from {origin[levels.source]}"
    off = "to use the radiographs as they are, set [calibrate] beam_level = false"
    mean, spread, (view, largest) = levels.levels.mean(), levels.levels.std(), levels.largest
    if spread < -STEADY_SHARE * mean:
        fact = f"the beam is brighter in all views than in the flats{monitored}: flats of another scan or exposure?"
        evidence = f"by {100 * np.expm1(-mean):.1f} %"
        return Finding(
            Level.WARNING, "beam-level", "reference", f"{fact} {corrected}", evidence, f"check the flats; {off}"
        )
    fact = f"the beam is not as bright in every view as in the flats{monitored}; {corrected}"
    evidence = (
        f"{100 * np.expm1(levels.rms):.1f} % root mean square, most in view {view}, {100 * np.expm1(-largest):+.1f} %"
    )
    level = Level.WARNING if levels.rms >= UNSTEADY_BEAM else Level.NOTE
    remedy = f"check that source and shutter are steady; {off}, and to name the pixels of air, [reference] air"
    return Finding(level, "beam-level", "reference", fact, evidence, remedy)
