"""Whether the level of the beam is estimated in the views of a reference scan, and what is told about it."""

from __future__ import annotations

import numpy as np

from grainmotion.calibration.beam_level import MIN_LEVEL_VIEWS, BeamLevels
from grainmotion.experiment.config import ExperimentFile
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.finding import Finding, Level

UNSTEADY_BEAM = 0.02
"""Root mean square of the levels from which the finding is a warning."""
STEADY_SHARE = 0.2
"""Standard deviation of the levels over their mean, below which the flats differ and not the views."""


def levels_wanted(tables: ExperimentFile, source: ScanInput) -> bool:
    """Whether levels are estimated: asked for, no air is named, and the views are enough."""
    asked = tables.calibrate.beam_level == "auto"
    return asked and source.air is None and len(source.geometry) >= MIN_LEVEL_VIEWS


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
