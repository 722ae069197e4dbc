"""Crowds: samples of any number of settled stones, seen by a panel that grows with them, with their truth.

Two heaps of 48 stones are settled by `simulate.pack` in cylinders, voxelised and cut into grains.  Copies of them are
stacked in hexagonal columns, each turned by a quarter of a circle or more about the vertical and every other one
upside down, and the stones nearest to the middle are kept.  That costs next to nothing, where settling all of them
would cost O(n²) with the packing as it is, and cutting them a tenth of a second each; the stones of one heap touch
each other, those of different heaps do not, and 38 % of the space is filled.

The reference is not reconstructed: it is the true attenuation of each voxel (from the shapes) with white noise, and
labels are true.  What follows measures the tracking alone.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels, store_contiguously
from grainmotion.simulate import Particle, Sample, motion_fields, stone
from grainmotion.simulate.detector import Physics, record_line_integrals
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.signed_distance import locator, signed_distances

Float = NDArray[np.float64]

ACROSS = 14
"""Voxels across a stone (the ball of its volume)."""
HEAP_STONES, HEAP_RADIUS, HEAP_GAP = 48, 2.0, 0.05
"""Stones of a heap; radius of its cylinder and gap between cylinders, stone diameters."""
MESH_LEVEL = 2
"""Subdivisions of a stone's mesh: 320 triangles, which *are* the stone."""
CENTRAL_LINE_INTEGRAL = 1.5
"""Line integral through the middle of a sample: the beam's energy is chosen to match its size."""
PHOTONS, VOXEL_NOISE = 1e6, 0.05
"""Photons a pixel (some tens of frames averaged); noise of the reference's voxels over the attenuation."""
VOXEL = 1.0 / ACROSS
"""mm: stones are 1 mm."""
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
STRAIN, SHIFT, TURN_DEG = 0.01, 2.0, 4.0
"""Every stone's motion: a strain of the whole sample, then up to so many voxels and degrees of its own."""


@dataclass(frozen=True, eq=False)
class Crowd:
    """A sample, its grains as a reference scan would give them, a later state and the truth of it."""

    grains: GrainSet
    scan: Scan
    truth: Motions
    width: float


@cache
def heap(seed: int) -> Sample:
    """Some settled stones, about the axis."""
    rng = np.random.default_rng(seed)
    stones = [stone(int(k), 1 + 0.08 * rng.uniform(-1, 1), MESH_LEVEL) for k in rng.permutation(95)[:HEAP_STONES]]
    return pack([Particle(s, 1.0) for s in stones], PackingSettings(HEAP_RADIUS), seed)


@cache
def heap_grains(seed: int) -> GrainSet:
    """The same stones as a reference scan would give them, of attenuation 1 per mm."""
    points = np.concatenate([p.shape.vertices for p in heap(seed).particles])
    across = 2 * int(np.ceil(np.abs(points).max() / VOXEL)) + 15
    return grains_from_labels(*rasterised(heap(seed), across, seed))


@dataclass(frozen=True, eq=False)
class Copy:
    """One stone of a heap: which heap and stone, and how it is turned and shifted."""

    heap: int
    stone: int
    turn: Float
    place: Float
    center: Float

    def particle(self, attenuation: float) -> Particle:
        """Its shape in place."""
        return Particle(heap(self.heap).particles[self.stone].shape.moved(self.turn, self.place), attenuation)

    def grain(self, label: int, attenuation: float) -> Grain:
        """Its voxels in place."""
        own = heap_grains(self.heap).grains[self.stone]
        volumes = [self._volume(v, attenuation) for v in (own.coarse_volume, own.fine_volume) if v is not None]
        return Grain(label, volumes[0], self.turn @ own.center + self.place, fine=volumes[1])

    def _volume(self, volume: Volume, attenuation: float) -> Volume:
        """Voxels of quarter turns about z and half ones about x are the same voxels in another order."""
        axes = [int(np.argmax(np.abs(row))) for row in self.turn]  # new x, y, z come from these
        flips = [k for k in range(3) if self.turn[k, axes[k]] < 0]
        array = volume.array.transpose([2 - axes[2], 2 - axes[1], 2 - axes[0]])
        array = np.flip(array, [2 - k for k in flips])
        x, y, z = self.turn @ volume.center + self.place
        return Volume(np.float32(attenuation) * array, volume.voxel_size, (float(x), float(y), float(z)))


def copies(n: int, seed: int = 0) -> list[Copy]:
    """``n`` stones of about 1 mm in a cylinder about as high as it is wide."""
    heaps = [2 * seed, 2 * seed + 1]
    middles = [np.array([p.shape.centroid for p in heap(h).particles]) for h in heaps]
    height = max(float(np.ptp(np.concatenate([p.shape.vertices[:, 2] for p in heap(h).particles]))) for h in heaps)
    step, rise = 2 * HEAP_RADIUS + HEAP_GAP, height + HEAP_GAP
    rng = np.random.default_rng([seed, n])
    side = (n * step**2 * np.sqrt(0.75) * rise / HEAP_STONES) ** (1 / 3)
    half = int(np.ceil(side / 2 / (step * np.sqrt(0.75)))) + 1
    found = list[Copy]()
    for i, j, k in np.ndindex(2 * half + 1, 2 * half + 1, 2 * half + 1):
        i, j, k = i - half, j - half, k - half
        place = np.array([step * (i + (j % 2) / 2), step * j * np.sqrt(0.75), rise * k])
        turn = rotation_matrix(np.array([0.0, 0.0, np.pi / 2 * rng.integers(4)]))
        if (i + j + k) % 2:
            turn = turn @ rotation_matrix(np.array([np.pi, 0.0, 0.0]))
        turn = np.round(turn)
        which = (i + k) % 2
        centers = middles[which] @ turn.T + place
        found += [Copy(heaps[which], stone, turn, place, c) for stone, c in enumerate(centers)]
    spots = np.array([f.center for f in found])
    out = np.maximum(np.linalg.norm(spots[:, :2], axis=1), np.abs(spots[:, 2]))
    return [found[k] for k in np.sort(np.argsort(out, kind="stable")[:n])]


def crowd(n: int, seed: int = 0, absent: Collection[int] = ()) -> Crowd:
    """``n`` stones, their grains, and a later state of them, without those of the rows ``absent``."""
    chosen = copies(n, seed)
    spots = np.array([c.center for c in chosen])
    radius = max(float(np.linalg.norm(spots[:, :2], axis=1).max()), float(np.abs(spots[:, 2]).max()))
    attenuation = CENTRAL_LINE_INTEGRAL / (0.38 * 2 * radius + 0.5)
    whole = Sample(tuple(c.particle(attenuation) for c in chosen))
    points = np.concatenate([p.shape.vertices for p in whole.particles])
    width = 2 * max(float(np.linalg.norm(points[:, :2], axis=1).max()), float(np.abs(points[:, 2]).max()))
    across = int(np.ceil(width * (1 + STRAIN) / VOXEL)) + 8 * int(np.ceil(SHIFT)) + 4
    distance = 12.0 * width
    views = Geometry.cone(
        ANGLES_DEG, (across, across), 4 * VOXEL, source_to_axis=distance, source_to_detector=4 * distance
    )
    moved = _motions(whole, seed)
    there = tuple(p for k, p in enumerate(whole.moved(moved).particles) if k not in absent)
    scan = record_line_integrals(Sample(there), views, Physics(photons=PHOTONS), seed + 1000)
    grains = [c.grain(label, attenuation) for label, c in enumerate(chosen, start=1)]
    store_contiguously(grains)
    return Crowd(GrainSet(tuple(grains)), scan, moved, width)


def rasterised(whole: Sample, across: int, seed: int) -> tuple[Volume, NDArray[np.int32]]:
    """Attenuation of each voxel with noise, and the stone that holds the most of it."""
    volume = Volume.zeros((across, across, across), VOXEL)
    array, labels, most = volume.array.copy(), np.zeros(volume.shape, np.int32), np.zeros(volume.shape, np.float32)
    for label, particle in zip(whole.labels, whole.particles, strict=True):
        box, share = _shares(particle, volume)
        array[box] += particle.attenuation * share
        mine = (share > most[box]) & (share >= 0.5)
        most[box] = np.where(mine, share, most[box])
        labels[box][mine] = label
    attenuation = whole.particles[0].attenuation
    array += VOXEL_NOISE * attenuation * np.random.default_rng(seed).standard_normal(array.shape, dtype=np.float32)
    return replace(volume, array=array), labels


def _shares(particle: Particle, grid: Volume) -> tuple[tuple[slice, slice, slice], NDArray[np.float32]]:
    """The part of the grid around a stone, and how much of each voxel it fills: 4³ points where the surface is."""
    body, origin = locator(particle.shape)
    vertices, h = particle.shape.vertices, grid.voxel_size
    low = np.floor((vertices.min(axis=0) - grid.origin) / h).astype(int)
    high = np.ceil((vertices.max(axis=0) - grid.origin) / h).astype(int) + 1
    z, y, x = np.meshgrid(*(np.arange(low[k], high[k]) for k in (2, 1, 0)), indexing="ij")
    centers = grid.origin + h * np.stack([x, y, z], axis=-1) - origin
    distances = signed_distances(body, centers.reshape(-1, 3)).reshape(x.shape)
    share = (distances <= 0).astype(np.float32)
    near = np.abs(distances) < 1.5 * h  # planes of slanting triangles overstate a distance
    steps = (np.arange(4) - 1.5) / 4 * h
    offsets = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    inside = signed_distances(body, (centers[near][:, None] + offsets).reshape(-1, 3)) <= 0
    share[near] = inside.reshape(-1, len(offsets)).mean(axis=1)
    return (slice(low[2], high[2]), slice(low[1], high[1]), slice(low[0], high[0])), share


def _motions(whole: Sample, seed: int) -> Motions:
    """A strain (shortening along z, widening across) and motions of each stone's own."""
    strain = STRAIN * np.array([[0.5, 0.2, 0.0], [-0.2, 0.5, 0.3], [0.0, 0.0, -1.0]])
    both = motion_fields.affine(whole, strain), motion_fields.random(whole, SHIFT * VOXEL, TURN_DEG, seed + 1)
    turns = rotation_vector(both[1].matrices @ both[0].matrices)
    return replace(both[0], translations=both[0].translations + both[1].translations, rotations=turns)
