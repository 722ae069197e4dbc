"""Make labels.tif: 1 the chip, 2 the cylinder with the dome on top of it.

    python examples/savu/label.py

A watershed cannot separate a body inside another, so the labels are made by thresholds.  The chip is the largest
connected body above the mean of its attenuation and the cylinder's.  The other body is the largest one in the
smoothed volume, its bubbles filled, without the chip.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.reconstruction.reconstruct import reconstruct

HERE = Path(__file__).parent
CHIP_THRESHOLD = 0.031  # attenuation of the chip is 0.050 a pixel, of the cylinder 0.012
DOME_THRESHOLD = 0.0008  # attenuation of the dome is 0.0017 a pixel


def largest(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected body of a mask, its holes filled."""
    bodies, number = ndimage.label(mask)
    sizes = ndimage.sum_labels(mask, bodies, np.arange(1, number + 1))
    return ndimage.binary_fill_holes(bodies == 1 + np.argmax(sizes))


def main() -> None:
    """Reconstruct as the experiment says, and write the labels."""
    experiment = read_experiment(HERE / "experiment.toml")
    inputs = find_inputs(experiment)
    assert inputs.reference is not None
    volume = reconstruct(inputs.reference.read()[0], inputs.grid, experiment.tables.reconstruct).volume.array
    chip = largest(volume > CHIP_THRESHOLD)
    body = largest(ndimage.gaussian_filter(volume, 1.5) > DOME_THRESHOLD)
    labels = np.where(chip, 1, np.where(body, 2, 0)).astype(np.uint8)
    tifffile.imwrite(HERE / "labels.tif", labels, compression="zlib")
    print(f"chip {int((labels == 1).sum())} voxels, cylinder and dome {int((labels == 2).sum())} voxels")


if __name__ == "__main__":
    main()
