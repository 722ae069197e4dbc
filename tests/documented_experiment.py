"""A small finished experiment, with the files that the examples of the documentation name."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np

from grainmotion.experiment.config import read_experiment
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.results_folder import read_results
from grainmotion.io.tiff import write_tiff
from grainmotion.workflow.run import run
from tiny_experiment import PANEL, VIEWS, VOXEL, counts, geometry, sample

RADIUS = 0.5  # mm
OCTAHEDRON = tuple((x, y, z, RADIUS) for x, y, z in RADIUS * np.sqrt(2) * np.vstack([np.eye(3), -np.eye(3)]))
"""Six balls, each of which touches four others."""
STEP = (0.05, -0.03, 0.04)  # mm, from each state to the next
ANGLES = (0.0, 45.0, 90.0)
TOML = """
[reference]
radiographs = "reference/*.tif"
flats = "flats/*.tif"
darks = "darks/*.tif"
geometry = "reference.csv"

[volume]
shape = [28, 36, 36]
voxel_size = 0.1

[calibrate]
geometry = false

[reconstruct]
sweeps = 3

[segment]
threshold = 0.5

[track]
search = false

[[states]]
name = "step-01"
radiographs = "step-01/*.tif"
geometry = "step-01.csv"

[[states]]
name = "step-02"
radiographs = "step-02/*.tif"
geometry = "step.csv"

[output]
exports = ["spam", "tiff", "dem"]

[dem]
shapes = ["stl", "level-set", "clump"]
codes = ["ls-dem"]
spheres = 5
"""
METAIMAGE = """ObjectType = Image
NDims = 3
DimSize = {2} {1} {0}
ElementSpacing = {voxel} {voxel} {voxel}
ElementType = MET_FLOAT
ElementByteOrderMSB = False
ElementDataFile = rec.raw
"""


def write_documented(folder: Path) -> None:
    """Write and run an experiment of two states; beside it a third state, and a volume of another program."""
    views = geometry(np.arange(VIEWS) * 360 / VIEWS)
    write_geometry(folder / "reference.csv", views)
    write_images(folder / "reference", counts(sample(balls=OCTAHEDRON), views))
    write_images(folder / "flats", np.full((3, *PANEL), 50_100, np.uint16))
    write_images(folder / "darks", np.full((2, *PANEL), 100, np.uint16))
    for k in (1, 2, 3):
        x, y, z = (k * component for component in STEP)
        write_images(folder / f"step-{k:02d}", counts(sample((x, y, z), OCTAHEDRON), geometry(ANGLES)))
    for name in ("step.csv", "step-01.csv"):
        write_geometry(folder / name, geometry(ANGLES))
    (folder / "experiment.toml").write_text(TOML)
    run(read_experiment(folder / "experiment.toml"))
    write_foreign_volume(folder)


def write_images(folder: Path, images: np.ndarray) -> None:
    """One TIFF file an image."""
    folder.mkdir(parents=True)
    for k, image in enumerate(images):
        write_tiff(folder / f"{k}.tif", image)


def write_foreign_volume(folder: Path) -> None:
    """The reference as a MetaImage, its labels as NIfTI."""
    results = read_results(folder / "results")
    results.volume.array.astype("<f4").tofile(folder / "rec.raw")
    (folder / "rec.mhd").write_text(METAIMAGE.format(*results.volume.shape, voxel=VOXEL))
    labels = nibabel.Nifti1Image(results.labels.transpose().astype(np.int16), np.diag([VOXEL] * 3 + [1]))
    labels.header.set_xyzt_units("mm")
    nibabel.save(labels, folder / "labels.nii.gz")
