"""Results of a run made by hand: three balls in two states, one of which is lost in the second."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.io.results import StoredReference, write_motions_h5, write_reference
from grainmotion.io.tiff import write_tiff
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels

VOXEL = 0.1
BALLS = ((-0.6, -0.3, -0.4, 0.4), (0.5, 0.4, 0.5, 0.45), (0.3, -0.6, 0.1, 0.35))  # x, y, z, radius, mm
LOST = 2  # row of the grain that is lost in the second state


@pytest.fixture(scope="session")
def reference():
    """Volume and labels of the balls; the grid is off the origin, so that a wrong place is seen."""
    grid = Volume.zeros((24, 26, 28), VOXEL, (0.2, -0.1, 0.3))
    z, y, x = np.meshgrid(
        *(grid.origin[k] + VOXEL * np.arange(n) for k, n in zip((2, 1, 0), grid.shape)), indexing="ij"
    )
    labels = np.zeros(grid.shape, np.int32)
    for label, (bx, by, bz, radius) in enumerate(BALLS, start=1):
        labels[(x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2 < radius**2] = label
    return StoredReference(replace(grid, array=(labels > 0).astype(np.float32)), labels=labels, threshold=0.5)


@pytest.fixture(scope="session")
def states(reference):
    """Motions of the two states."""
    grains = grains_from_labels(reference.volume, reference.labels)
    still = Motions.identity(grains.labels, grains.centers)
    one = replace(
        still,
        translations=np.array([(0.1, 0.0, -0.05), (0.0, 0.2, 0.0), (0.05, 0.05, 0.05)]),
        rotations=np.array([(0, 0, 0.3), (0.1, 0, 0), (0, -0.2, 0.1)], dtype=float),
        covariances=np.tile(np.eye(6) * 1e-6, (3, 1, 1)),
        statuses=np.array(["converged"] * 3),
        residuals=np.full(3, 0.01),
    )
    statuses = np.where(np.arange(3) == LOST, "not-converged", "converged")
    return {"one": one, "two": replace(one, translations=2 * one.translations, statuses=statuses)}


@pytest.fixture(scope="session")
def folder(reference, states, tmp_path_factory):
    """The folder of the results."""
    folder = tmp_path_factory.mktemp("run") / "results"
    folder.mkdir()
    write_reference(folder / "reference.h5", reference)
    for name, motions in states.items():
        (folder / name).mkdir()
        write_motions_h5(folder / name / "motions.h5", motions)
        images = np.linspace(-1, 3, 2 * 5 * 6, dtype=np.float32).reshape(2, 5, 6)
        images[0, 0, 0] = np.nan
        write_tiff(folder / name / "residuals.tif", images)
    return folder
