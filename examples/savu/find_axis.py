"""Find the rotation axis to a few hundredths of a pixel, from the radiographs alone.

    python examples/savu/find_axis.py

Two independent methods.  (1) The first and the last radiograph are 180° apart: one is the mirror image of the
other about the axis, so the axis minimises the difference; its tilt in the image is fitted as well.  (2) A wrong
axis makes the scan inconsistent: the axis minimises the residual ε of the reconstruction (the vertex of a parabola
through five trials).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct

HERE = Path(__file__).parent
ROWS = slice(60, 130)  # chip and cylinder
COLUMNS = slice(20, 140)


def mirrored_pair(first: NDArray[np.float32], last: NDArray[np.float32]) -> tuple[float, float]:
    """Column of the axis at mid-height, and its tilt in the image, degrees."""
    row, column = np.mgrid[ROWS, COLUMNS].astype(float)
    middle = (first.shape[0] - 1) / 2

    def difference(unknowns: NDArray[np.float64]) -> float:
        axis = unknowns[0] + np.tan(np.deg2rad(unknowns[1])) * (row - middle)
        mirror = map_coordinates(last, [row, 2 * axis - column], order=3, mode="nearest")
        return float(((first[ROWS, COLUMNS] - mirror) ** 2).mean())

    best = minimize(difference, [86.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-12})
    return float(best.x[0]), float(best.x[1])


def least_residual(images: NDArray[np.float32], angles_deg: NDArray[np.float64], rows: slice) -> float:
    """Column of the axis that minimises the residual of given rows; rows are independent in a parallel beam."""
    part = np.ascontiguousarray(images[:, rows])
    shape = part.shape[1:]
    middle = (shape[1] - 1) / 2
    trials = np.arange(85.25, 86.5, 0.25)
    settings = ReconstructSettings(sweeps=3, tolerance=0)
    squares = []
    for axis in trials:
        panel = DetectorAlignment(axis_offset=axis - middle, first_row="top")
        scan = Scan(part, Geometry.parallel(angles_deg, shape, 1.0, panel=panel))
        squares.append(reconstruct(scan, Volume.zeros((shape[0], 112, 112), 1.0), settings).residuals[-1] ** 2)
    curve = np.polyfit(trials, squares, 2)
    return float(-curve[1] / (2 * curve[0]))


def main() -> None:
    """Print the axis by each method."""
    reference = find_inputs(read_experiment(HERE / "experiment.toml")).reference
    assert reference is not None
    images = reference.read()[0].line_integrals
    angles = np.loadtxt(HERE / "data" / "angles_deg.txt")[::2]
    column, tilt = mirrored_pair(images[0], images[-1])
    print(f"0/180° pair:      axis at column {column:.2f}, tilted by {tilt:+.3f}° in the image")
    for name, rows in (("chip's top", slice(64, 84, 3)), ("chip", slice(86, 110, 4)), ("cylinder", slice(112, 134, 3))):
        print(f"least residual:   axis at column {least_residual(images, angles, rows):.2f}  ({name})")


if __name__ == "__main__":
    main()
