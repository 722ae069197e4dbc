"""Five grains of one shape on the voxels of an ideal scan, and radiographs of them by the voxel-free simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import (
    Ellipsoid,
    Particle,
    Sample,
    attenuation_volume,
    label_volume,
    line_integrals,
    polyhedron,
    stone,
)

VOXEL, DIAMETER = 0.125, 16.0  # mm; voxels
PLACES = 0.95 * DIAMETER * VOXEL * np.array([[-1, -1, -1], [1, 1, -1], [1, -1, 1], [-1, 1, 1], [0, 0, 0]])
NOISE = 0.004  # of a line integral; those of a grain are 0.2
CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


def prism(sides: int):
    """An upright prism."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return polyhedron(np.concatenate([np.column_stack([ring, np.full(sides, z)]) for z in (-1.1, 1.1)]))


def chipped_cube():
    """A cube without one of its corners, by a cut across its three edges at different lengths."""
    kept = CORNERS[~(CORNERS == 1).all(axis=1)]
    return polyhedron(np.concatenate([kept, [[-0.2, 1, 1], [1, 0.3, 1], [1, 1, -0.6]]]))


SHAPES = {
    "cube": lambda: polyhedron(CORNERS),
    "chipped cube": chipped_cube,
    "cuboid": lambda: polyhedron(CORNERS * [1, 1.25, 1.6]),
    "hexagonal prism": lambda: prism(6),
    "triangular prism": lambda: prism(3),
    "tetrahedron": lambda: polyhedron(CORNERS[CORNERS.prod(axis=1) > 0]),
    "ellipsoid": lambda: Ellipsoid(np.zeros(3), np.array([1, 1.25, 1.6]), np.eye(3)),
    "ball": lambda: Ellipsoid(np.zeros(3), np.ones(3), np.eye(3)),
}


@cache
def group(name: str):
    """The rotations that carry a solid to itself: those of its corners, or half turns of an ellipsoid."""
    if name == "ellipsoid":
        return np.array([np.diag(signs) for signs in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])])
    shape = SHAPES[name]()
    points = shape.vertices - shape.centroid
    first, second = 0, int(np.argmax(np.linalg.norm(np.cross(points[0], points), axis=1)))
    frames = {
        (i, j): np.column_stack([points[i], points[j], np.cross(points[i], points[j])])
        for i in range(len(points))
        for j in range(len(points))
    }
    matrices = [frame @ np.linalg.inv(frames[first, second]) for frame in frames.values()]
    rotations = [m for m in matrices if np.allclose(m @ m.T, np.eye(3), atol=1e-6)]
    gaps = [np.linalg.norm((points @ m.T)[:, None] - points, axis=2).min(axis=1).max() for m in rotations]
    return np.array([m for m, gap in zip(rotations, gaps) if gap < 1e-6])


def particle(name: str, place, matrix) -> Particle:
    """A grain of the usual volume; ``stone 7`` is one of the gravel stones."""
    shape = stone(int(name.split()[1])) if name.startswith("stone") else SHAPES[name]()
    size = np.cbrt(np.pi / 6 * (DIAMETER * VOXEL) ** 3 / shape.volume)
    return Particle(shape.moved(size * np.asarray(matrix), place), 0.1)


@dataclass(frozen=True, eq=False)
class Case:
    """A sample and its grains on voxels."""

    sample: Sample
    grains: GrainSet
    rotations: np.ndarray  # (n, 3, 3), from the shapes as they are made
    names: tuple[str, ...]

    def equivalent_poses(self, row, matrix):
        """All rotations that carry a grain to where ``matrix`` does, by its own symmetries ``(k, 3, 3)``."""
        own = self.rotations[row]
        return np.array([matrix @ own @ g @ own.T for g in group(self.names[row])])

    def state(self, truth: Motions, geometry: Geometry) -> Scan:
        """Noisy radiographs of a later state."""
        images = line_integrals(self.sample.moved(truth), geometry, subsamples=2)
        noise = np.random.default_rng(3).normal(scale=NOISE, size=images.shape)
        return Scan((images + noise).astype(np.float32), geometry)

    def rotated(self, vectors_deg) -> Motions:
        """Each grain shifted by half a voxel, and rotated: ``(3,)`` or ``(n, 3)``, degrees."""
        vectors = np.broadcast_to(np.deg2rad(vectors_deg), (len(self.sample), 3))
        shifts = np.random.default_rng(1).uniform(-0.5, 0.5, (len(self.sample), 3)) * VOXEL
        still = Motions.identity(self.sample.labels, self.sample.centers)
        statuses = np.full(len(self.sample), Status.CONVERGED.value, dtype="<U20")
        return replace(still, translations=shifts, rotations=vectors.copy(), statuses=statuses)


@cache
def case(*names: str, aligned: bool = False, seed: int = 0) -> Case:
    """Grains of these shapes, at random rotations unless ``aligned`` with the axes."""
    rng = np.random.default_rng(seed)
    particles, rotations = [], []
    for name, place in zip(names, PLACES):
        matrix = np.eye(3) if aligned else rotation_matrix(rng.normal(size=3))
        rotations.append(matrix)
        particles.append(particle(name, place + rng.uniform(-0.5, 0.5, 3) * VOXEL, matrix))
    sample, grid = Sample(tuple(particles)), Volume.zeros((64, 64, 64), VOXEL)
    volume = attenuation_volume(sample, grid, 2)
    texture = 1 + 0.05 * np.random.default_rng(seed + 1).normal(size=volume.shape)  # noise of a reconstruction
    volume = replace(volume, array=(volume.array * texture).astype(np.float32))
    return Case(sample, grains_from_labels(volume, label_volume(sample, grid)), np.array(rotations), names)


def cone(angles_deg) -> Geometry:
    """A laboratory scanner: the sample 3 % of the way from the axis to the source."""
    return Geometry.cone(angles_deg, (64, 64), 4 * VOXEL, source_to_axis=120, source_to_detector=480)
