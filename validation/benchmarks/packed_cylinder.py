"""A cylinder of grains as large as a user's: ellipsoids 22 voxels across on a jittered lattice, as files of counts.

The radiographs are projected from voxels by the package itself, so that this is for times and memory, not for
accuracy.  One later state of four views, in which each grain moved by up to 2 voxels and 4° on its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project

RADIUS, SPACING = 11.0, 2.12
"""Of the ball of a grain's volume, voxels; distance of neighbours over it."""
FILLED_RADIUS = 0.4
"""Radius of the sample over the edge of the volume."""
VOXEL, PIXEL, ATTENUATION = 0.1, 0.2, 0.05
"""mm, mm, 1/mm; the magnification is 2."""
PHOTONS, DARK = 40_000, 100
"""Counts of the open beam and of the dark."""
SHIFT, TURN_DEG, STATE_ANGLES_DEG = 2.0, 4.0, (0.0, 45.0, 90.0, 135.0)
VIEWS_AT_ONCE = 32

Float = NDArray[np.float64]


def write_packed_cylinder(size: int, folder: Path, views: int | None = None) -> int:
    """Write an experiment of ``size``³ voxels and as many views, unless it is there; the number of grains."""
    done = folder / "grains.txt"
    if done.exists():
        return int(done.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    centers, axes, turned = _grains(size, rng)
    count = len(centers)
    shifts = rng.uniform(-SHIFT, SHIFT, (count, 3))
    turns = Rotation.from_rotvec(np.radians(TURN_DEG) * rng.uniform(-1, 1, (count, 3))).as_matrix()
    views = size if views is None else views
    angles = tuple(360.0 * k / views for k in range(views))
    _write_scan(_voxels(size, centers, axes, turned), angles, folder / "reference", rng)
    _write_scan(_voxels(size, centers + shifts, axes, turns @ turned), STATE_ANGLES_DEG, folder / "state", rng)
    for name, level in (("flat", PHOTONS + DARK), ("dark", DARK)):
        tifffile.imwrite(folder / f"{name}.tif", np.full((size, size), level, np.uint16))
    (folder / "experiment.toml").write_text(_experiment(size, angles))
    done.write_text(str(count))
    return count


def voxelised_cylinder(size: int) -> tuple[Volume, NDArray[np.int32]]:
    """The same grains without a scan: attenuation on ``size``³ voxels, and the label of each voxel."""
    rng = np.random.default_rng(1)
    centers, axes, turned = _grains(size, rng)
    labels, deepest = np.zeros((size,) * 3, np.int32), np.zeros((size,) * 3, np.float16)
    for label, (box, depth) in enumerate(_depths(size, centers, axes, turned), start=1):
        inside = depth > deepest[box]
        labels[box][inside], deepest[box][inside] = label, depth[inside]
    return _voxels(size, centers, axes, turned), labels


def _grains(size: int, rng: np.random.Generator) -> tuple[Float, Float, Float]:
    """Centres, half axes (voxels over the radius) and rotations."""
    centers = _places(size, rng)
    axes = np.exp(rng.uniform(-0.18, 0.18, (len(centers), 3)))
    axes *= RADIUS / np.cbrt(axes.prod(axis=1))[:, None]
    return centers, axes, Rotation.from_rotvec(rng.normal(size=(len(centers), 3))).as_matrix()


def _places(size: int, rng: np.random.Generator) -> Float:
    """Centres (x, y, z) from the middle, voxels."""
    radius, step = FILLED_RADIUS * size, SPACING * RADIUS
    line = np.arange(-radius, radius + 1, step)
    places = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    places += rng.uniform(-0.8, 0.8, places.shape)
    inside = (np.hypot(places[:, 0], places[:, 1]) < radius - RADIUS) & (np.abs(places[:, 2]) < radius - RADIUS)
    return places[inside]


def _voxels(size: int, centers: Float, axes: Float, rotations: Float) -> Volume:
    """The grains as attenuation, with the partial volumes of their surfaces."""
    array = np.zeros((size,) * 3, np.float32)
    for box, depth in _depths(size, centers, axes, rotations):
        np.maximum(array[box], ATTENUATION * np.clip(depth + 0.5, 0, 1), out=array[box], casting="unsafe")
    return Volume(array, VOXEL)


def _depths(size: int, centers: Float, axes: Float, rotations: Float) -> Iterator[tuple[tuple[slice, ...], Float]]:
    """Of each grain a box of voxels around it, and how far these lie below its surface, voxels."""
    middle, reach = (size - 1) / 2, int(1.3 * RADIUS) + 2
    for center, half, rotation in zip(centers, axes, rotations, strict=True):
        nearest = np.round(center + middle).astype(int)
        box = [slice(max(k - reach, 0), min(k + reach + 1, size)) for k in nearest]
        grids = np.meshgrid(*[np.arange(s.start, s.stop) - middle for s in box], indexing="ij")
        scaled = (np.stack(grids, axis=-1) - center) @ rotation / half
        depth = (1 - np.linalg.norm(scaled, axis=-1)) * RADIUS
        yield (box[2], box[1], box[0]), depth.transpose(2, 1, 0)


def _distances(size: int) -> tuple[float, float]:
    """Distances of the axis and of the panel from the source, mm."""
    to_axis = 200.0 * size / 512
    return to_axis, 2 * to_axis


def _write_scan(volume: Volume, angles: tuple[float, ...], folder: Path, rng: np.random.Generator) -> None:
    size = volume.shape[0]
    to_axis, to_panel = _distances(size)
    folder.mkdir(exist_ok=True)
    for first in range(0, len(angles), VIEWS_AT_ONCE):
        part = angles[first : first + VIEWS_AT_ONCE]
        views = Geometry.cone(part, (size, size), PIXEL, source_to_axis=to_axis, source_to_detector=to_panel)
        for k, image in enumerate(project(volume, views), start=first):
            counts = DARK + rng.poisson(PHOTONS * np.exp(-image))
            tifffile.imwrite(folder / f"{k:05d}.tif", counts.astype(np.uint16))


def _experiment(size: int, angles: tuple[float, ...]) -> str:
    to_axis, to_panel = _distances(size)
    setup = f'beam = "cone", source_to_axis = {to_axis}, source_to_detector = {to_panel}, pixel_size = {PIXEL}'
    setup += ', first_row = "bottom", angles_deg = '
    beam = 'flats = "flat.tif"\ndarks = "dark.tif"\n'
    circle = f"{{ first = 0.0, last = {angles[-1]!r}, count = {len(angles)} }}"
    return (
        f'[reference]\nradiographs = "reference/*.tif"\n{beam}geometry = {{ {setup}{circle} }}\n\n'
        f"[volume]\nshape = [{size}, {size}, {size}]\nvoxel_size = {VOXEL}\n\n"
        f'[[states]]\nname = "one"\nradiographs = "state/*.tif"\n{beam}'
        f"geometry = {{ {setup}{list(STATE_ANGLES_DEG)} }}\n"
    )
