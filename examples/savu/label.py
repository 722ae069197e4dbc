"""Make labels.tif: 1 the chip, 2 the cylinder with the dome on top of it.

    python examples/savu/label.py

One body inside another is no case for a watershed, so the labels are given.  The chip is the largest
body above the middle of its attenuation and the cylinder's; the rest is what remains after a light blur,
with its bubbles filled.
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
CHIP = 0.031  # the chip has 0.050 a pixel, the cylinder 0.012
DOME = 0.0008  # the dome has 0.0017


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
    chip = largest(volume > CHIP)
    body = largest(ndimage.gaussian_filter(volume, 1.5) > DOME)
    labels = np.where(chip, 1, np.where(body, 2, 0)).astype(np.uint8)
    tifffile.imwrite(HERE / "labels.tif", labels, compression="zlib")
    print(f"chip {int((labels == 1).sum())} voxels, cylinder and dome {int((labels == 2).sum())} voxels")


if __name__ == "__main__":
    main()
