"""Capture range in three dimensions: share of grains recovered from a zero start, against the size of the motion."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.figure import Figure

from grainmotion.analysis.validation import compare
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import (
    PackingSettings,
    Particle,
    Sample,
    attenuation_volume,
    label_volume,
    line_integrals,
    motion_fields,
    pack,
    stone,
)
from grainmotion.tracking.track import track
from validation.common.cache import SEGMENTATION
from validation.common.trials import run_trials
from validation.paper.page import PAGE, Section, figure, table

STONE_COUNT = 95
DIAMETER_VOXELS = {15: 20.0, 200: 14.0}  # voxels, by number of grains; a voxel is 1 mm
TUBE_RADIUS = {15: 26.0, 200: 42.0}  # radii
PANEL = {15: (200, 240), 200: (220, 220)}
VIEWS = (2, 3, 4, 6)
RELATIVE_NOISE = 0.01  # of the largest line integral
FAILURE_LIMITS = {"limit_voxels": 1.0, "limit_deg": 5.0}
DIRECTION = np.array([0.6, -0.5, 0.62]) / np.linalg.norm([0.6, -0.5, 0.62])


@dataclass(frozen=True)
class Move:
    """A motion: all by ``rigid`` voxels; or each grain by up to ``shift`` diameters and ``rotation_deg``."""

    rigid: float = 0.0
    shift: float = 0.0
    rotation_deg: float = 0.0


RIGID = [Move(rigid=r) for r in (0.0, 30.0, 60.0)]
SHIFTED = [Move(shift=s, rotation_deg=30.0) for s in (0.25, 0.5, 0.75, 1.0)]
ROTATED = [Move(shift=0.5, rotation_deg=w) for w in (0.0, 15.0, 30.0, 60.0)]
MOVES = {15: dict.fromkeys(RIGID + SHIFTED + ROTATED), 200: dict.fromkeys([RIGID[1], SHIFTED[0]])}
GOAL_MOVE = Move(shift=0.5, rotation_deg=30.0)


@dataclass(frozen=True)
class Outcome:
    """Grains recovered (within 1 voxel and 5°), converged though not recovered, and the CPU time spent."""

    recovered: int
    wrong: int
    cpu: float


def study() -> Section:
    """15 grains: all moves and numbers of views."""
    outcomes = run(15, VIEWS)
    goal = outcomes[GOAL_MOVE, 4]
    caption = "Share of 15 grains recovered from a zero start."
    text = f"""{setting(15)}

{figure("capture", _draw(outcomes, 15), caption)}
{cells(outcomes, 15, VIEWS)}
The goal, all of 15 grains with 4 views up to 30° and one grain radius of random motion, is
{"met" if goal.recovered == 15 else "NOT met"}: {goal.recovered} of 15."""
    return Section("Capture in three dimensions: 15 grains", text)


def run(n: int, views: tuple[int, ...]) -> dict[tuple[Move, int], Outcome]:
    """All moves of n grains, each with all numbers of views."""
    jobs = [(n, move, v) for move in MOVES[n] for v in views]
    sample(n)  # before the processes share it
    return {job[1:]: outcome for job, outcome in zip(jobs, run_trials(_run, jobs), strict=True)}


def setting(n: int) -> str:
    """How the cases are made, in words."""
    return f"""{n} touching gravel stones {DIAMETER_VOXELS[n]:.0f} voxels across, simulated without voxels, cone beam,
noise of {RELATIVE_NOISE:.0%} of the largest line integral; views evenly over 180° (2 views: 22.5° and 112.5°).  The
reference is the exact sample averaged over voxels, so that no reconstruction is needed.  Default settings, zero start.
A grain is recovered within 1 voxel and 5°."""


def cells(outcomes: dict[tuple[Move, int], Outcome], n: int, views: tuple[int, ...]) -> str:
    """The table of all outcomes."""
    rows = [[_words(move), *(_cell(outcomes[move, v], n) for v in views)] for move in MOVES[n]]
    wrong = sum(o.wrong for o in outcomes.values())
    return f"""Cells: grains recovered; in brackets those that say converged and are not, then CPU seconds.

{table(["motion", *(f"{v} views" for v in views)], rows)}
Over all cases {wrong} grains say converged and are not.
"""


@cache
@PAGE.cached(*SEGMENTATION)
def sample(n: int) -> tuple[Sample, GrainSet]:
    """The packing, and its grains on voxels."""
    rng = np.random.default_rng(0)
    order = rng.permutation(max(n, STONE_COUNT))
    shapes = [stone(int(i) % STONE_COUNT, DIAMETER_VOXELS[n] * (1 + 0.08 * rng.uniform(-1, 1))) for i in order]
    packed = pack([Particle(s, 0.02) for s in shapes[:n]], PackingSettings(TUBE_RADIUS[n]), 0)
    corners = np.concatenate([p.shape.vertices for p in packed.particles])
    low, high = corners.min(axis=0), corners.max(axis=0)
    nz, ny, nx = (int(np.ceil(s)) + 6 for s in (high - low)[::-1])
    x, y, z = (low + high) / 2
    grid = Volume.zeros((nz, ny, nx), 1.0, (x, y, z))
    labels = label_volume(packed, grid).astype(np.int64)
    return packed, grains_from_labels(attenuation_volume(packed, grid), labels)


def _run(job: tuple[int, Move, int]) -> Outcome:
    n, move, views = job
    packing, grains = sample(n)
    true = _motions(packing, move, DIAMETER_VOXELS[n])
    angles = tuple(180.0 / views * np.arange(views)) if views > 2 else (22.5, 112.5)
    geometry = Geometry.cone(angles, PANEL[n], 1.25, source_to_axis=600.0, source_to_detector=750.0)
    images = line_integrals(packing.moved(true), geometry, subsamples=2)
    images = images + np.random.default_rng(1).normal(size=images.shape) * RELATIVE_NOISE * images.max()
    start = time.process_time()
    measured = track(grains, Scan(images.astype(np.float32), geometry))
    cpu = time.process_time() - start
    errors = compare(measured, true, 1.0, **FAILURE_LIMITS)
    shift = np.linalg.norm(errors.translation_errors, axis=1) <= FAILURE_LIMITS["limit_voxels"]
    placed = shift & (np.linalg.norm(errors.rotation_errors_deg, axis=1) <= FAILURE_LIMITS["limit_deg"])
    converged = np.zeros(n, dtype=bool)
    found = errors.matches >= 0
    converged[found] = measured.ok[errors.matches[found]]
    return Outcome(int(placed.sum()), int((converged & ~placed).sum()), cpu)


def _motions(packing: Sample, move: Move, diameter: float) -> Motions:
    if move.rigid or not (move.shift or move.rotation_deg):
        return motion_fields.rigid(packing, move.rigid * DIRECTION)
    return motion_fields.random(packing, move.shift * diameter, move.rotation_deg, 5)


def _words(move: Move) -> str:
    if move.rigid or not (move.shift or move.rotation_deg):
        return f"all by {move.rigid:.0f} voxels"
    return f"each up to {move.shift:g} diameter, {move.rotation_deg:.0f}°"


def _cell(outcome: Outcome, n: int) -> str:
    return f"{outcome.recovered / n:.0%} ({outcome.wrong}; {outcome.cpu:.0f} s)"


def _draw(outcomes: dict[tuple[Move, int], Outcome], n: int) -> Figure:
    image = Figure(figsize=(13, 3.6), layout="constrained")
    sweeps = [
        (RIGID, "rigid", "shift of the whole sample, voxels"),
        (SHIFTED, "shift", "largest shift of each grain, diameters (with 30°)"),
        (ROTATED, "rotation_deg", "largest rotation of each grain, ° (with half a diameter)"),
    ]
    for axes, (moves, name, label) in zip(image.subplots(1, 3, sharey=True), sweeps, strict=True):
        for views in VIEWS:
            shares = [outcomes[move, views].recovered / n for move in moves]
            axes.plot([getattr(move, name) for move in moves], shares, "o-", label=f"{views} views")
        axes.set(xlabel=label, ylim=(-0.05, 1.05))
    image.axes[0].set_ylabel("share of grains recovered")
    image.axes[0].legend()
    return image
