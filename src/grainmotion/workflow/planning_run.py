"""Planning of an experiment file or a simulated case, and the files of a plan:

PLAN/plan.csv    one row a grain and set of views: predicted sd, mm and degrees
PLAN/angles.csv  one row a set of views: angles, medians over the grains, motions to expect
PLAN/plan.png    the same as a figure
"""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from grainmotion import simulate
from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.experiment.circular import circular_geometry
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.files import atomic_write, checked_folder
from grainmotion.io.results import read_reference
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.planning.candidates import candidate_angles, nearest_views
from grainmotion.planning.plan import Plan, PlanSettings, plan
from grainmotion.report.plan_figure import plan_figure
from grainmotion.segmentation.extraction import extract_grains, grains_from_labels
from grainmotion.segmentation.segment import Segmentation
from grainmotion.workflow.context import load_result
from grainmotion.workflow.reference_stages import REFERENCE
from grainmotion.workflow.results_description import describe_results
from grainmotion.workflow.run import run

PLAN_FOLDER = "plan"


def plan_experiment(
    experiment: Experiment,
    settings: PlanSettings | None = None,
    *,
    out: Path | None = None,
    progress: Progress | None = None,
) -> tuple[Plan, Path]:
    """Plan the states of an experiment from its reference, which is reconstructed and segmented unless that is done.

    By default ``settings`` are ``[plan]`` and ``out`` is ``[output] directory``.  Returns the plan and its folder.
    """
    settings = settings or experiment.tables.plan
    views = _candidates(experiment, settings)
    done = run(experiment, out=out, until="segment", progress=progress)
    reference = load_result(read_reference, done.folder / REFERENCE)
    assert reference.labels is not None
    segmentation = Segmentation(reference.labels, reference.threshold, reference.border)
    grains = extract_grains(reference.volume, segmentation, replace(experiment.tables.segment, finer=1))
    result = _planned(grains, views, settings, done.folder, progress)
    describe_results(done.folder, experiment)
    return result


def plan_case(
    case: Literal["small", "paper"],
    settings: PlanSettings | None = None,
    *,
    out: Path,
    photons: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Plan, Path]:
    """Plan from the exact voxels of a simulated packing; ``photons`` are by default the case's, not the settings'."""
    folder = checked_folder(out)
    simulated = (simulate.small if case == "small" else simulate.paper_scale)(seed, progress=progress)
    exposure = simulated.physics.photons if photons is None else photons
    settings = replace(settings or PlanSettings(), photons=exposure)
    grid = simulated.scanner.grid
    volume = simulate.attenuation_volume(simulated.sample, grid)
    grains = grains_from_labels(volume, simulate.label_volume(simulated.sample, grid), finer=1)
    angles = tuple(float(a) for a in candidate_angles("cone", settings))
    return _planned(grains, simulated.scanner.geometry(angles), settings, folder, progress)


def _planned(
    grains: GrainSet, views: Geometry, settings: PlanSettings, out: Path, progress: Progress | None
) -> tuple[Plan, Path]:
    """Plan and write the files of the plan; returns it and its folder."""
    result, folder = plan(grains, views, settings, progress=progress), out / PLAN_FOLDER
    with atomic_write(folder / "plan.csv") as path:
        result.to_table().to_csv(path, index=False, float_format="%.8g")
    with atomic_write(folder / "angles.csv") as path:
        result.angles_table().to_csv(path, index=False, float_format="%.6g")
    with atomic_write(folder / "plan.png") as path:
        about = "precision predicted for sets of views, voxels and degrees; numbers in plan.csv and angles.csv"
        told = {"Software": f"grainmotion {version('grainmotion')}", "Description": about}
        plan_figure(result).savefig(path, dpi=130, metadata=told)
    return result, folder


def _candidates(experiment: Experiment, settings: PlanSettings) -> Geometry:
    """Views to choose from: a circular scan at all candidate angles, or the nearest of a scan's own views."""
    scan = _first_scan(experiment)
    if scan.circle is not None:
        beam = scan.geometry.beam
        return circular_geometry(scan.circle, beam, scan.geometry.shape, candidate_angles(beam, settings))
    return nearest_views(scan.geometry, settings)


def _first_scan(experiment: Experiment) -> ScanInput:
    """The reference scan or, where only a volume is given, the first state."""
    tables, inputs = experiment.tables, find_inputs(experiment)
    if inputs.reference is not None:
        return inputs.reference
    if tables.reference.radiographs is not None:
        return find_scan("reference", tables.reference, tables.reference, experiment.folder)
    if inputs.states:
        return inputs.states[0]
    fact = "there is no scan whose geometry the plan could use"
    raise InputError("reference.radiographs", fact, "name the reference's radiographs and geometry, or a state")
