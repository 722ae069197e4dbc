"""Cases that are tracked with the kernels of every code target, and their motions in a file.

``python tests/targets/cases.py OUT.npz SAMPLES`` runs all cases with the kernels and the BLAS that the environment
selects (and with ``tests`` and the root of the repository on PYTHONPATH); SAMPLES are those of the paper's Table 2.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info
from validation.paper import images, table2

from grainmotion.cli.demo import run_demo
from grainmotion.io.results import read_motions_h5
from grainmotion.model.motions import Motions
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, small
from grainmotion.tracking.track import TrackSettings, track

STONE_RADIUS = 10.0
"""Radius of the stones of the small case, voxels."""


@dataclass(frozen=True)
class Outcome:
    """Motions of a state, the voxel size (mm) and the radius of a grain (voxels).

    ``rough`` says that the cost has a local minimum every voxel, among which rounding chooses: results may differ.
    """

    motions: Motions
    voxel: float
    radius: float = STONE_RADIUS
    rough: bool = False


Outcomes = dict[str, Outcome]


def tiny_grain() -> Outcomes:
    """Three grains from a poor reference and two views, by either projector (as the studies compile their kernels).

    Along the exact path, single sums made its normal matrix indefinite on some processors.
    """
    case = small(n_grains=3)
    scan = case.reference().select(slice(None, None, 6))
    volume = reconstruct(scan, case.scanner.grid, ReconstructSettings(sweeps=1)).volume
    grains = grains_from_labels(volume, segment(volume).labels)
    later = case.state(case.motions["unmoved"], LATER_ANGLES_DEG[2])
    exact = track(grains, later, settings=TrackSettings(projector="exact"))
    return {
        "poor reference": Outcome(track(grains, later), grains.voxel_size),
        "poor reference, exact path": Outcome(exact, grains.voxel_size, rough=True),
    }


def small_packing() -> Outcomes:
    """Six stones of 20 voxels from a noisy scan of 90 views, with small motions and with large ones."""
    case = small()
    volume = reconstruct(case.reference(), case.scanner.grid).volume
    grains = grains_from_labels(volume, segment(volume).labels)
    truths = {
        "random motions": case.motions["random"],
        "misregistered grains": displaced(case.motions["unmoved"], 8.0, 60.0),
    }
    outcomes: Outcomes = {}
    for name, truth in truths.items():
        for views in (4, 2) if name == "random motions" else (4,):
            measured = track(grains, case.state(truth, LATER_ANGLES_DEG[views]))
            outcomes[f"{name}, {views} views"] = Outcome(measured, grains.voxel_size)
    return outcomes


def displaced(still: Motions, voxels: float, degrees: float) -> Motions:
    """Every grain shifted and rotated in a random direction, too far for Gauss–Newton alone."""
    directions = np.random.default_rng(4).normal(size=(2, len(still), 3))
    shifts, axes = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    distance = voxels * small().scanner.voxel_size
    return replace(still, translations=distance * shifts, rotations=np.deg2rad(degrees) * axes)


def planar(samples: int) -> Outcomes:
    """Samples of the paper's Table 2 from two views, which only a search solves: by far the longest case."""
    outcomes: Outcomes = {}
    for seed in range(samples):
        grains = images.draw(seed).grains()
        scan = images.observe(grains, images.large_motions(grains, seed), 2)
        measured = track(grains, scan, settings=table2.SETTINGS)
        outcomes[f"table 2, sample {seed}"] = Outcome(measured, 1.0, images.DIAMETER / 2)
    return outcomes


def end_to_end() -> Outcomes:
    """A simulated scan of six stones as TIFFs, an experiment file and two states, by `run`, as a user does."""
    with tempfile.TemporaryDirectory() as folder:
        run_demo(Path(folder))
        files = sorted(Path(folder).glob("results/*/motions.h5"))
        assert len(files) == 2
        voxel = small().scanner.voxel_size
        return {f"run, state {file.parent.name}": Outcome(read_motions_h5(file), voxel) for file in files}


CASES: tuple[Callable[[], Outcomes], ...] = (tiny_grain, small_packing, end_to_end)


def blas() -> list[str]:
    """The processors for which the BLAS in use chose its kernels."""
    return sorted({str(library.get("architecture")) for library in threadpool_info() if library["user_api"] == "blas"})


def measure(out: Path, samples: int) -> None:
    """Run all cases and save their motions, with the BLAS in use."""
    arrays: dict[str, np.ndarray] = {"blas": np.array(blas())}
    for case in (*CASES, partial(planar, samples)):
        for name, outcome in case().items():
            motions = outcome.motions
            columns = {
                "statuses": np.array(motions.statuses),
                "translations": motions.translations,
                "rotations": motions.rotations,
                "sds": np.sqrt(np.diagonal(motions.covariances, axis1=1, axis2=2)),
                "voxel": np.array(outcome.voxel),
                "radius": np.array(outcome.voxel * outcome.radius),
                "rough": np.array(outcome.rough),
            }
            arrays |= {f"{name}/{key}": value for key, value in columns.items()}
    np.savez(out, **arrays)


if __name__ == "__main__":
    measure(Path(sys.argv[1]), int(sys.argv[2]))
