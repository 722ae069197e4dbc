"""Errors of the example's results against the known motions, in pixels and degrees.

    grainmotion run examples/savu/experiment.toml
    python examples/savu/check.py            # the two states of that run
    python examples/savu/check.py --all      # and all 11 disjoint choices of four unused radiographs

Exits with code 1 if an error of the chip, which is well determined, exceeds 0.1 pixel or 0.5° in a state of the run.
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
TRUE_ROTATIONS_DEG = {"unmoved": 0.0, "turned": 10.0}  # of the whole sample about z
BODIES = {1: "chip", 2: "cylinder"}
MAX_CHIP_TRANSLATION_ERROR, MAX_CHIP_ROTATION_ERROR_DEG = 0.1, 0.5  # pixel, degree


def errors(measured: Motions, rotation_deg: float) -> NDArray[np.float64]:
    """Translation (pixels) and rotation (degrees) errors ``(n, 6)``, x y z each."""
    rotation = rotation_matrix([0.0, 0.0, np.deg2rad(rotation_deg)])
    translations = measured.centers @ rotation.T - measured.centers
    rotations = np.rad2deg(rotation_vector(measured.matrices @ rotation.T))
    return np.concatenate([measured.translations - translations, rotations], axis=1)


def check_run(folder: Path) -> bool:
    """Print the errors of each state, and return whether those of the chip are within the limits."""
    passed = True
    print(f"{'state':9}{'body':10}{'status':19}   error: x, y, z (pixels)     about x, y, z (degrees)   lengths")
    for state, rotation_deg in TRUE_ROTATIONS_DEG.items():
        measured = read_motions(folder / state / "motions.csv")
        for label, status, e in zip(measured.labels, measured.statuses, errors(measured, rotation_deg)):
            translation_error, rotation_error = np.linalg.norm(e[:3]), np.linalg.norm(e[3:])
            numbers = " ".join(f"{v:+8.3f}" for v in e[:3]) + "  " + " ".join(f"{v:+8.2f}" for v in e[3:])
            print(
                f"{state:9}{BODIES[label]:10}{status:19}{numbers}   {translation_error:.3f} px, {rotation_error:.2f}°"
            )
            if BODIES[label] == "chip":
                passed &= status == "converged" and translation_error <= MAX_CHIP_TRANSLATION_ERROR
                passed &= rotation_error <= MAX_CHIP_ROTATION_ERROR_DEG
    return passed


def check_all(folder: Path) -> None:
    """Track every choice of four radiographs that the reconstruction did not use, and print the errors' statistics."""
    experiment = read_experiment(HERE / "experiment.toml")
    scan_input = find_inputs(experiment).reference
    table = experiment.tables.reference.geometry
    assert scan_input is not None
    assert table is not None
    assert not isinstance(table, str)
    angles = np.loadtxt(HERE / "data" / "angles_deg.txt")
    reference = read_reference(folder / "reference.h5")
    assert reference.labels is not None
    grains = grains_from_labels(reference.volume, reference.labels)
    for state, rotation_deg in TRUE_ROTATIONS_DEG.items():
        measured = []
        for first in range(1, 22, 2):  # 11 choices among the unused, odd radiographs
            views = np.arange(first, 88, 22)
            geometry = circular_geometry(table, "parallel", scan_input.geometry.shape, angles[views] + rotation_deg)
            scan, _ = dataclasses.replace(scan_input, views=views, geometry=geometry).read()
            measured.append(errors(track(grains, scan, settings=experiment.tables.track), rotation_deg))
        rms, worst = np.sqrt(np.mean(np.square(measured), axis=0)), np.abs(measured).max(axis=0)
        print(f"{state}: {len(measured)} choices of four radiographs; root mean square (largest) error")
        for body, r, w in zip(BODIES.values(), rms, worst):
            cells = [f"{a:.3f} ({b:.3f})" for a, b in zip(r, w)]
            print(f"  {body:9} x, y, z: {', '.join(cells[:3])} px   about x, y, z: {', '.join(cells[3:])}°")


def main() -> int:
    """Check the results of the last run."""
    folder = HERE / "results"
    passed = check_run(folder)
    if "--all" in sys.argv[1:]:
        check_all(folder)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
