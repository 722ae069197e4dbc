"""Errors of the example's results against the known motions, in pixels and degrees.

    grainmotion run examples/savu/experiment.toml
    python examples/savu/check.py            # the two states of that run
    python examples/savu/check.py --all      # and all 11 disjoint choices of four unused radiographs

Exits with code 1 if the chip, which is well determined, is off by more than 0.1 pixel or 0.5° in a state
of the run.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grainmotion.experiment.circular import circular_geometry
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.motions_csv import read_motions
from grainmotion.io.results import read_reference
from grainmotion.model.motions import Motions
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.track import track

HERE = Path(__file__).parent
TURNS_DEG = {"unmoved": 0.0, "turned": 10.0}  # true motion of everything: a turn about z
BODIES = {1: "chip", 2: "cylinder"}
CHIP_LIMITS = (0.1, 0.5)  # pixel, degree


def errors(measured: Motions, turn_deg: float) -> NDArray[np.float64]:
    """Translation (pixels) and rotation (degrees) errors ``(n, 6)``, x y z each."""
    turn = rotation_matrix([0.0, 0.0, np.deg2rad(turn_deg)])
    translations = measured.centers @ turn.T - measured.centers
    rotations = np.rad2deg(rotation_vector(measured.matrices @ turn.T))
    return np.concatenate([measured.translations - translations, rotations], axis=1)


def check_run(folder: Path) -> bool:
    """Print the errors of each state; whether the chip is within its limits."""
    passed = True
    print(f"{'state':9}{'body':10}{'status':19}   error: x, y, z (pixels)     about x, y, z (degrees)   lengths")
    for state, turn in TURNS_DEG.items():
        measured = read_motions(folder / state / "motions.csv")
        for label, status, e in zip(measured.labels, measured.statuses, errors(measured, turn)):
            lengths = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
            numbers = " ".join(f"{v:+8.3f}" for v in e[:3]) + "  " + " ".join(f"{v:+8.2f}" for v in e[3:])
            print(f"{state:9}{BODIES[label]:10}{status:19}{numbers}   {lengths[0]:.3f} px, {lengths[1]:.2f}°")
            if BODIES[label] == "chip":
                passed &= status == "converged" and lengths[0] <= CHIP_LIMITS[0] and lengths[1] <= CHIP_LIMITS[1]
    return passed


def check_all(folder: Path) -> None:
    """Track at other radiographs that the reconstruction did not use, and print the spread of the errors."""
    experiment = read_experiment(HERE / "experiment.toml")
    given = find_inputs(experiment).reference
    table = experiment.tables.reference.geometry
    assert given is not None
    assert table is not None
    assert not isinstance(table, str)
    angles = np.loadtxt(HERE / "data" / "angles_deg.txt")
    reference = read_reference(folder / "reference.h5")
    assert reference.labels is not None
    grains = grains_from_labels(reference.volume, reference.labels)
    for state, turn in TURNS_DEG.items():
        found = []
        for first in range(1, 22, 2):  # every fourth part of the unused half
            views = np.arange(first, 88, 22)
            geometry = circular_geometry(table, "parallel", given.geometry.shape, angles[views] + turn)
            scan, _ = dataclasses.replace(given, views=views, geometry=geometry).read()
            found.append(errors(track(grains, scan, settings=experiment.tables.track), turn))
        rms, worst = np.sqrt(np.mean(np.square(found), axis=0)), np.abs(found).max(axis=0)
        print(f"{state}: {len(found)} choices of four radiographs; root mean square (largest) error")
        for body, r, w in zip(BODIES.values(), rms, worst):
            cells = [f"{a:.3f} ({b:.3f})" for a, b in zip(r, w)]
            print(f"  {body:9} x, y, z: {', '.join(cells[:3])} px   about x, y, z: {', '.join(cells[3:])}°")


def main() -> int:
    """Check the run that is there."""
    folder = HERE / "results"
    passed = check_run(folder)
    if "--all" in sys.argv[1:]:
        check_all(folder)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
