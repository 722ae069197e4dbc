"""Height of the grains over their width: pixels that are not square, in both scans, leave no other trace."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.finding import Finding, Level
from grainmotion.model.label_sums import label_sizes
from grainmotion.model.progress import counted

PLATE = 0.25
"""Height over width, or its inverse, below which a body is a plate or a pillar and does not count; platens: 0.18."""
MIN_GRAINS_FOR_SHAPES = 4
"""Grains from which their mean tells something."""
USUAL_SLENDERNESS = (0.57, 1.75)
"""Geometric mean of height over width without a remark.

Stones that settled gave 0.64 to 1.04 (5 to 20 grains, 59 samples), so that pixels twice as tall as told make it 0.32 to
0.52; medians overlap.  Flat grains that all lie are told as well.
"""


def check_grain_shapes(labels: NDArray[np.integer], where: str = "pixel_size") -> tuple[Finding, ...]:
    """A finding if most grains are about half as high as they are wide, or twice.

    Parameters
    ----------
    labels : (nz, ny, nx) int array
        Grains, 0 for none.
    where : str
        Key, for the finding.

    Returns
    -------
    tuple of Finding
        At most one.
    """
    ratios = heights_over_widths(labels)
    ratios = ratios[(ratios > PLATE) & (ratios < 1 / PLATE)]
    ratio = float(np.exp(np.log(ratios).mean())) if len(ratios) >= MIN_GRAINS_FOR_SHAPES else 1.0
    if USUAL_SLENDERNESS[0] < ratio < USUAL_SLENDERNESS[1]:
        return ()
    fact = (
        f"most grains are {ratio:.2g} times as high as they are wide: pixels that are not square, as of a panel with "
    )
    fact += "binned rows or columns only, or grains that are so and lie or stand all alike"
    evidence = f"geometric mean of {len(ratios)} grains; stones have 0.6 to 1"
    remedy = "if the pixels are not square, resample the radiographs, or give geometry as a CSV file with their u and v"
    return (Finding(Level.WARNING, "grain-sizes", where, fact, evidence, remedy),)


def heights_over_widths(labels: NDArray[np.integer]) -> Float:
    """Standard deviation of the voxels of each grain along z over that along x and y, ``(grains,)``."""
    counts = label_sizes(labels)
    sums, squares = np.zeros((2, 3, len(counts)))  # along z, y, x
    for z, plane in enumerate(counted(labels)):
        y, x = np.nonzero(plane)
        grains = plane[y, x]
        for axis, place in enumerate((np.full(len(grains), z), y, x)):
            for power, total in ((1, sums), (2, squares)):
                own = np.bincount(grains, place.astype(float) ** power)
                total[axis, : len(own)] += own
    counts[0] = 0
    present = counts > 1
    variances = squares[:, present] / counts[present] - (sums[:, present] / counts[present]) ** 2
    height, *widths = variances
    width = (widths[0] + widths[1]) / 2
    extended = (width > 0) & (height > 0)
    return np.asarray(np.sqrt(height[extended] / width[extended]))
