"""A small report for the tests: two states, every status, and names that contain markup."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.model.motions import Motions, Status
from grainmotion.model.state_fit import StateFit
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData, StateReport

MARKUP = "</script><img src=x onerror=alert(1)> & $x$"
COSTS = (("whole sample $a$", 0.5), ("whole sample $a$", 0.2), ("all <grains>", 0.05), ("all <grains>", 0.02))


def motions(n: int = 6) -> Motions:
    """Motions of grains 1, 11, 21, ...: the first five statuses, then converged; the left-field grain has no motion."""
    random = np.random.default_rng(3)
    arrays = {
        "translations": random.normal(size=(n, 3)),
        "rotations": random.normal(size=(n, 3)) * 0.1,
        "covariances": np.eye(6) * random.uniform(1e-4, 2e-4, (n, 1, 1)),
    }
    statuses = np.full(n, Status.CONVERGED.value, dtype="<U20")
    statuses[: min(5, n)] = [s.value for s in Status][: min(5, n)]
    for array in arrays.values():
        array[statuses == Status.LEFT_FIELD.value] = np.nan
    reasons = tuple("" if s == Status.CONVERGED.value else f"{s}, because {MARKUP}" for s in statuses)
    return replace(
        Motions.identity(np.arange(n) * 10 + 1, random.normal(size=(n, 3)) * 5),
        **arrays,
        statuses=statuses,
        residuals=random.uniform(0.01, 0.02, n),
        iterations=np.arange(n) + 7,
        reasons=reasons,
        fit=StateFit(1.01, -0.002, COSTS),
    )


def state(name: str, n: int = 6, shape: tuple[int, int, int] = (2, 30, 20)) -> StateReport:
    """A state with n grains and images of the given shape (views, rows, columns)."""
    random = np.random.default_rng(4)
    simulated = random.random(shape)
    measured = simulated + random.normal(size=shape) * 0.02
    measured[0, 3, 4] = np.nan
    return StateReport(
        name=name,
        measured=measured,
        simulated=simulated,
        motions=motions(n),
        voxel_size=0.112,
        views=tuple(f"{90 * i}° {MARKUP}" for i in range(shape[0])),
        comparison=(("translation error", f"0.012 voxel {MARKUP}"),),
    )


def data() -> ReportData:
    """The whole report."""
    labels = np.zeros((9, 8, 7), np.int32)
    labels[2:7, 2:6, 2:5] = 3
    return ReportData(
        title=f"Gravel {MARKUP}",
        facts=(("grains", "6"), (MARKUP, MARKUP)),
        reconstruction_errors=(0.3, 0.1, 0.05),
        volume=Volume(labels * 0.03, 0.112),
        labels=labels,
        states=(state("step-01"), state(f"step-02 {MARKUP}")),
    )
