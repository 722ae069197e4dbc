"""Simulated experiments on disk, and a run of one of them compared with its truth."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion import simulate
from grainmotion._typing import Progress
from grainmotion.analysis.validation import Comparison, compare
from grainmotion.backends.device import DeviceName
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.motions_csv import read_motions, write_motions
from grainmotion.io.results import read_reference
from grainmotion.workflow import outputs
from grainmotion.workflow.dataset import check_new_dataset, write_dataset
from grainmotion.workflow.reference_stages import REFERENCE
from grainmotion.workflow.run import RunResult, run

PLAIN_CASES = {"small": simulate.small, "paper": simulate.paper_scale}
ALL_STATES = (("unmoved", 4), ("shift", 4), ("shift", 2), ("random", 4), ("random", 2))
DEMO_STATES = (("shift", 4), ("random", 4))
CASE_FILE = "case.json"
"""What was simulated, with its seed."""


@dataclass(frozen=True, eq=False)
class Demo:
    """Result of the demo, and its comparison with the truth by the name of the state."""

    result: RunResult
    comparisons: dict[str, Comparison]


def write_case(
    folder: str | Path,
    case: str = "small",
    seed: int = 0,
    states: Sequence[tuple[str, int]] = ALL_STATES,
    *,
    progress: Progress | None = None,
) -> Path:
    """Simulate an experiment, write it with the truth of each state, and return the path of its file.

    ``case`` is ``small`` or ``paper`` (see `simulate.small` and `simulate.paper_scale`), or one of
    `simulate.HARD_CASES`.  Each of ``states`` is the name of a motion of the case and a number of views (2 or 4); the
    state is called ``NAME-VIEWS``.  A hard case has one motion, and the states ``CASE-4`` and ``CASE-2``; where its
    true views are not those of the experiment file, they are in ``STATE-true-views.csv``.  True motions of pistons are
    in ``STATE-bodies-truth.csv``; ``case.json`` holds name and seed, and says what is hard, with its sizes.
    """
    check_new_dataset(folder)  # before minutes of simulation
    if case in simulate.HARD_CASES:
        hard = simulate.hard_case(case, seed, progress=progress)
        path = _write_hard_case(Path(folder), hard, progress)
        _write_facts(path, {"name": hard.name, "seed": seed, "summary": hard.summary, "facts": dict(hard.facts)})
        return path
    if case not in PLAIN_CASES:
        known = ", ".join([*PLAIN_CASES, *simulate.HARD_CASES])
        raise InputError("case", f"'{case}' is unknown", f"choose one of {known}")
    simulated = PLAIN_CASES[case](seed, progress=progress)
    recordings = {}
    for number, (name, views) in enumerate(states, start=1):
        if progress is not None:
            progress("simulating radiographs", number - 1, len(states) + 1)
        truth = simulated.motions[name]
        later = simulated.state_counts(truth, simulate.LATER_ANGLES_DEG[views], number)
        recordings[f"{name}-{views}"] = (later, truth)
    if progress is not None:
        progress("simulating radiographs", len(states), len(states) + 1)
    grid = simulated.scanner.grid
    path = write_dataset(folder, simulated.reference_counts(), recordings, grid, initial="reference")
    _write_facts(path, {"name": case, "seed": seed})
    return path


def _write_facts(experiment: Path, facts: Mapping[str, object]) -> None:
    """What was simulated, beside its experiment file."""
    text = json.dumps(facts, indent=2, ensure_ascii=False) + "\n"
    (experiment.parent / CASE_FILE).write_text(text, encoding="utf-8")


def _write_hard_case(folder: Path, hard: simulate.HardCase, progress: Progress | None) -> Path:
    recordings, views = {}, {"reference": (hard.nominal_geometry(), hard.true_reference_geometry())}
    for number, (count, angles_deg) in enumerate(sorted(simulate.LATER_ANGLES_DEG.items(), reverse=True), start=1):
        if progress is not None:
            progress("simulating radiographs", number - 1, 3)
        name = f"{hard.name}-{count}"
        recordings[name] = (hard.state_counts(angles_deg, number), hard.motions)
        views[name] = (hard.nominal_geometry(angles_deg), hard.true_geometry(angles_deg, number))
    if progress is not None:
        progress("simulating radiographs", 2, 3)
    grid = hard.case.scanner.grid
    path = write_dataset(folder, hard.reference_counts(), recordings, grid, initial="reference")
    _write_body_truth(folder, hard, list(recordings))
    for name, (nominal, true) in views.items():
        if not np.allclose(nominal.vectors, true.vectors, rtol=0, atol=1e-9):
            write_geometry(folder / f"{name}-true-views.csv", true)
    return path


def _write_body_truth(folder: Path, hard: simulate.HardCase, states: Sequence[str]) -> None:
    """The true motions of bodies."""
    for state in states:
        if hard.body_motions is not None:
            write_motions(folder / f"{state}-bodies-truth.csv", hard.body_motions)


def run_demo(
    folder: str | Path, seed: int = 0, *, device: DeviceName = "auto", progress: Progress | None = None
) -> Demo:
    """Simulate the small case, measure its motions, and compare them with the truth.

    An earlier demo in the folder is continued, if it has the same seed.
    """
    folder = Path(folder)
    earlier = folder / CASE_FILE
    names = [f"{name}-{views}" for name, views in DEMO_STATES]
    files = ["experiment.toml", *(f"{name}-truth.csv" for name in names)]
    if not all((folder / name).is_file() for name in files):
        write_case(folder, "small", seed, DEMO_STATES, progress=progress)
    elif earlier.is_file():
        made_with = json.loads(earlier.read_text(encoding="utf-8")).get("seed", seed)
        if made_with != seed:
            fact = f"{folder} holds the demo of seed {made_with}, not {seed}"
            raise InputError("--seed", fact, "choose another folder")
    experiment = read_experiment(folder / "experiment.toml").on(device)
    result = run(experiment, progress=progress)
    reference = read_reference(result.folder / REFERENCE)
    comparisons = {
        name: compare(motions, read_motions(folder / f"{name}-truth.csv"), reference.volume.voxel_size)
        for name, motions in result.motions.items()
    }
    facts = {name: comparison_facts(c) for name, c in comparisons.items()}
    inputs = find_inputs(experiment)
    scans = {source.key.removeprefix("states."): source.read()[0] for source in inputs.states}
    results = outputs.Results(experiment, inputs, result.folder, reference, scans, result.motions)
    outputs.write_report(dataclasses.replace(results, findings=result.findings), facts)
    return Demo(result, comparisons)


def comparison_facts(comparison: Comparison) -> tuple[tuple[str, str], ...]:
    """A comparison with the truth, as facts for the report."""
    return (
        ("Translation error, rms a component", f"{comparison.translation_rms_voxels:.4f} voxel"),
        ("Rotation error, rms a component", f"{comparison.rotation_rms_deg:.4f}°"),
        ("Grains that failed", f"{comparison.failures} of {len(comparison)}"),
    )
