"""Fig. 4: the cost of one grain against its rotation, and where the solver ends from wrong starts; translations too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix
from grainmotion.tracking.track import TrackSettings, track
from validation.common.trials import run_trials
from validation.paper import images
from validation.paper.page import Section, figure, table
from validation.paper.table1 import EXACT, PLAIN

Float = NDArray[np.float64]
SAMPLES = 20
ROTATIONS_DEG = np.arange(-90.0, 91.0, 5.0)
SHIFTS = np.array([0.25, 0.5, 0.75, 1.0])  # diameters
DIRECTIONS_DEG = np.arange(0.0, 360.0, 45.0)
WITH_SEARCH = TrackSettings(gain=False, trend="none", tolerance=1e-10)
SOLVERS = {"plain": PLAIN, "with search": WITH_SEARCH}
NEAR_SYMMETRY = 0.1  # of the highest cost: a second valley this deep makes a grain nearly symmetric


@dataclass(frozen=True, eq=False)
class Trial:
    """One grain: cost at `FINE_DEG`; by solver, ω (degrees) reached from `ROTATIONS_DEG`, and whether exactly;
    whether the true place was reached from each shift and direction ``(shifts, directions)``."""

    cost: Float
    reached_deg: dict[str, Float]
    rotated: dict[str, NDArray[np.bool_]]
    shifted: dict[str, NDArray[np.bool_]]

    @property
    def symmetric(self) -> bool:
        """Whether another valley, over 20° away, is nearly as deep as the true one."""
        far = self.cost[np.abs(FINE_DEG) > 20]
        return bool(far.min() < NEAR_SYMMETRY * self.cost.max())


FINE_DEG = np.arange(-90.0, 90.5, 0.5)


def trial(seed: int, rotations_deg: Float = ROTATIONS_DEG, directions_deg: Float = DIRECTIONS_DEG) -> Trial:
    """The innermost grain of a sample, at rest, from starts that are wrong."""
    grains = images.draw(seed).grains("one")
    scan = images.observe(grains, Motions.identity(grains.labels, grains.centers), 2)
    rotated_ends = {
        name: [_end(grains, scan, settings, rotation_deg=r) for r in rotations_deg]
        for name, settings in SOLVERS.items()
    }
    shifts = {
        name: np.array(
            [
                [_exact(_end(grains, scan, settings, shift=s * images.DIAMETER * _unit(d))) for d in directions_deg]
                for s in SHIFTS
            ]
        )
        for name, settings in SOLVERS.items()
    }
    return Trial(
        _costs(grains, scan),
        {name: np.array([np.rad2deg(m.rotations[0, 2]) for m in ends]) for name, ends in rotated_ends.items()},
        {name: np.array([_exact(m) for m in ends]) for name, ends in rotated_ends.items()},
        shifts,
    )


def study() -> Section:
    """Curves of the first grain, and counts over all."""
    trials = run_trials(trial, range(SAMPLES))
    plain_range = [_range(t.rotated["plain"]) for t in trials]
    distinct = [t for t in trials if not t.symmetric]
    rows = []
    for name in SOLVERS:
        rotated = np.array([t.rotated[name] for t in trials])
        shifted = np.array([t.shifted[name] for t in trials])
        row = [name, f"{rotated.sum()} of {rotated.size}"]
        row.append(f"{sum(t.rotated[name].sum() for t in distinct)} of {len(distinct) * len(ROTATIONS_DEG)}")
        rows.append(row + [f"{s.sum()} of {s.size}" for s in shifted.transpose(1, 0, 2)])
    head = ["solver", "rotated starts, all grains", f"the {len(distinct)} without near-symmetry"]
    head += [f"shifted by {s:g} diameter" for s in SHIFTS]
    caption = (
        "Left: the cost of one grain against its rotation. Middle: the rotation reached against the initial guess. "
        "Right: share of the grains recovered against the initial guess."
    )
    near = len(trials) - len(distinct)
    text = f"""One grain alone, 2 views, true motion none, {SAMPLES} grains from as many samples.  Starts are rotated by
up to ±90° every 5° ({len(ROTATIONS_DEG)} a grain), or shifted in {len(DIRECTIONS_DEG)} directions.  A start succeeds if
the end is exact to {EXACT:g} of a pixel and of a radian.  A grain is nearly symmetric if the cost falls below
{NEAR_SYMMETRY:.0%} of its highest value more than 20° away from the truth; {near} of {len(trials)} are.

{figure("figure4", _draw(trials[0], trials), caption)}
{table(head, rows)}
The plain solver succeeds from starts within {np.median(plain_range):.0f}° (median over the grains;
{min(plain_range):.0f}° to {max(plain_range):.0f}°); the paper within about 30°."""
    return Section("Fig. 4: capture of one grain", text)


def _end(
    grains: GrainSet, scan: Scan, settings: TrackSettings, rotation_deg: float = 0.0, shift: Float | None = None
) -> Motions:
    start = Motions.identity(grains.labels, grains.centers)
    start.rotations[:, 2] = np.deg2rad(rotation_deg)
    if shift is not None:
        start.translations[:, :2] = shift
    return track(grains, scan, start, settings)


def _exact(measured: Motions) -> bool:
    truth = Motions.identity(measured.labels, measured.centers)
    return bool((images.errors(measured, truth) <= EXACT).all())


def _costs(grains: GrainSet, scan: Scan) -> Float:
    """F(0, 0, ω), pixel by pixel, over `FINE_DEG`."""
    target = Target(scan, np.zeros_like(scan.line_integrals), "trilinear", sigma=0.0)
    problem = StateProblem(GrainArrays.of(grains), target)
    vectors = np.deg2rad(FINE_DEG)[:, None] * np.array([0.0, 0.0, 1.0])
    return np.array([problem.linearize(Pose(np.zeros((1, 3)), m[None])).cost for m in rotation_matrix(vectors)])


def _unit(direction_deg: float) -> Float:
    return np.array([np.cos(np.deg2rad(direction_deg)), np.sin(np.deg2rad(direction_deg))])


def _range(succeeded: NDArray[np.bool_]) -> float:
    """Degrees on both sides of the truth from which every start succeeds."""
    failed = np.abs(ROTATIONS_DEG[~succeeded])
    return float(failed.min() - 5.0) if len(failed) else 90.0


def _draw(first: Trial, trials: list[Trial]) -> Figure:
    image = Figure(figsize=(13, 3.8), layout="constrained")
    left, middle, right = image.subplots(1, 3)
    left.plot(FINE_DEG, first.cost / first.cost.max())
    left.set(xlabel="ω, °", ylabel="F(0, 0, ω) / largest")
    for name, marker in zip(SOLVERS, ("o", "x"), strict=True):
        middle.plot(ROTATIONS_DEG, first.reached_deg[name], marker, label=name)
        right.plot(ROTATIONS_DEG, np.mean([t.rotated[name] for t in trials], axis=0), marker + "-", label=name)
    middle.set(xlabel="initial ω, °", ylabel="ω reached, °")
    right.set(xlabel="initial ω, °", ylabel="share of grains recovered", ylim=(-0.05, 1.05))
    middle.legend()
    right.legend()
    return image
