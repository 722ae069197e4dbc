"""A tiny experiment on disk: three balls in a cone beam, a reference scan and two later states."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.tiff import write_tiff
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project

PANEL = (28, 36)
VOXEL = 0.1
BALLS = ((-0.75, -0.25, -0.3, 0.55), (0.65, -0.35, 0.3, 0.6), (0.0, 0.85, 0.0, 0.5))  # x, y, z, radius, mm
SHIFTS = {"one": (0.1, 0.0, 0.05), "two": (0.15, -0.05, 0.1)}  # mm
VIEWS = 40

TOML = """
[reference]
radiographs = "reference/*.tif"
flats = "flats.tif"
darks = "darks.tif"
geometry = "reference.csv"

[volume]
shape = [28, 36, 36]
voxel_size = 0.1

[reconstruct]
sweeps = 3

[segment]
threshold = 0.5

[track]
search = false

[[states]]
name = "one"
radiographs = "one.tif"
geometry = "one.csv"

[[states]]
name = "two"
radiographs = "two.npy"
[states.geometry]
beam = "cone"
source_to_axis = 50
source_to_detector = 200
pixel_size = 0.4
first_row = "bottom"
angles_deg = [10.0, 55.0, 100.0]
"""


def geometry(angles_deg: ArrayLike) -> Geometry:
    """Views of the cone-beam scanner at the given angles."""
    return Geometry.cone(angles_deg, PANEL, 4 * VOXEL, source_to_axis=50, source_to_detector=200)


def sample(shift: tuple[float, float, float] = (0.0, 0.0, 0.0), balls: Sequence[Sequence[float]] = BALLS) -> Volume:
    """Attenuation of the balls: 1/mm with soft surfaces, and an off-centre core of 2/mm."""
    z, y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * VOXEL for n in (28, 36, 36)), indexing="ij")
    array = np.zeros(x.shape)
    for bx, by, bz, radius in balls:
        for dx, r in ((0.0, radius), (0.3 * radius, 0.4 * radius)):
            offset = (x - bx - shift[0] - dx, y - by - shift[1] - dx / 2, z - bz - shift[2])
            array += np.clip((r - np.sqrt(sum(p**2 for p in offset))) / VOXEL + 0.5, 0, 1)
    return Volume(array, VOXEL)


def counts(volume: Volume, views: Geometry) -> np.ndarray:
    """Detector counts with noise, for a dark level of 100 and a flat level of 50100."""
    noise = np.random.default_rng(len(views)).normal(0, 30, (len(views), *PANEL))
    return np.round(100 + 50_000 * np.exp(-project(volume, views)) + noise).astype(np.uint16)


def write_tiny(folder: Path, toml: str = TOML) -> Path:
    """Write the experiment's files and return the path of its TOML."""
    (folder / "reference").mkdir(parents=True, exist_ok=True)
    views = geometry(np.arange(VIEWS) * 360 / VIEWS)
    write_geometry(folder / "reference.csv", views)
    for k, image in enumerate(counts(sample(), views)):
        write_tiff(folder / "reference" / f"{k}.tif", image)
    write_tiff(folder / "flats.tif", np.full((3, *PANEL), 50_100, np.uint16))
    write_tiff(folder / "darks.tif", np.full((2, *PANEL), 100, np.uint16))
    write_geometry(folder / "one.csv", geometry([0.0, 45.0, 90.0]))
    write_tiff(folder / "one.tif", counts(sample(SHIFTS["one"]), geometry([0.0, 45.0, 90.0])))
    np.save(folder / "two.npy", counts(sample(SHIFTS["two"]), geometry([10.0, 55.0, 100.0])))
    path = folder / "experiment.toml"
    path.write_text(toml)
    return path
