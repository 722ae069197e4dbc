"""Laboratory: a sample of a few stones and its scanner, drawn from a seed, and their radiographs by the simulator.

Line integrals are exact (`grainmotion.simulate`), so nothing is shared with the projector of the tracker.  Odd seeds
have a parallel beam, even ones a cone beam.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import (
    PackingSettings,
    Particle,
    Physics,
    Sample,
    Tube,
    attenuation_volume,
    label_volume,
    motion_fields,
    pack,
    polyhedron,
    record,
    stone,
)
from validation.accuracy.page import PAGE
from validation.common.cache import SIMULATION

Float = NDArray[np.float64]
Counts = NDArray[np.uint16]
VOXEL, PANEL, VIEWS = 0.125, (64, 64), 60  # mm; pixels
RADIUS = 22  # of the cylinder that holds the stones, voxels
MAGNIFICATION = 4.0
STATE_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
MAX_MOTION = (3.0, 8.0)  # voxels, degrees
OTHER_SEED = 2  # another sample is that of the seed after the next
STONE_SHAPES = 95  # that the package has
CUBE = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
CUBE_PLACES = np.array([[-1, -1, -1], [1, 1, -1], [1, -1, 1], [-1, 1, 1], [0, 0, 0]])
CUBE_EDGE, CUBE_SPACING = 13.0, 14.0  # voxels


@dataclass(frozen=True)
class Recipe:
    """What a laboratory has that is not drawn from its seed.

    ``cubes`` are five cubes, rotated by so many degrees in the later state; ``faint`` is the attenuation of every third
    stone over that of the others; ``size_spread`` half the range of sizes of the stones, relative; ``state_beam`` the
    beam of the later state over that of the flats; ``rise`` the height, mm, by which the stage rises during the full
    scan; and ``around`` what stays in place around the stones.
    """

    seed: int
    cubes: float | None = None
    faint: float = 1.0
    size_spread: float = 0.08
    photons: float = 20_000.0
    span_deg: float = 360.0
    state_views: tuple[float, ...] = STATE_ANGLES_DEG
    state_beam: float = 1.0
    rise: float = 0.0
    views: int = VIEWS
    around: Literal["", "cell", "platens"] = ""


@dataclass(frozen=True, eq=False)
class Laboratory:
    """Scanner, sample and motions of a recipe."""

    recipe: Recipe

    @cached_property
    def draws(self) -> dict[str, float]:
        """What is drawn from the seed besides the stones."""
        rng = np.random.default_rng([self.recipe.seed, 7])
        return {
            "stones": int(rng.integers(5, 9)),
            "diameter": rng.uniform(14, 18),
            "attenuation": rng.uniform(0.1, 0.25),
            "source_to_axis": rng.uniform(60, 120),
            "sense": int(rng.choice([-1, 1])),
            "top": int(rng.integers(2)),
            "start": float(rng.choice([0.0, 10.0, 22.5])),
        }

    @property
    def beam(self) -> str:
        """``cone`` or ``parallel``."""
        return "parallel" if self.recipe.seed % 2 else "cone"

    @property
    def pixel_size(self) -> float:
        """mm."""
        return VOXEL * (MAGNIFICATION if self.beam == "cone" else 1)

    @property
    def angles_deg(self) -> Float:
        """Of the full scan."""
        n, span = self.recipe.views, self.recipe.span_deg
        return self.draws["sense"] * np.arange(n) * span / n

    @property
    def state_angles_deg(self) -> Float:
        """Of the later state."""
        return self.draws["sense"] * (np.array(self.recipe.state_views) + self.draws["start"])

    @property
    def distances(self) -> dict[str, float]:
        """Keys of the geometry of a cone beam."""
        if self.beam == "parallel":
            return {}
        near = round(float(self.draws["source_to_axis"]), 3)
        return {"source_to_axis": near, "source_to_detector": MAGNIFICATION * near}

    def geometry(self, angles_deg: Float) -> Geometry:
        """True views; the stage rises evenly in the course of them."""
        make = Geometry.parallel if self.beam == "parallel" else Geometry.cone
        views = make(angles_deg, PANEL, self.pixel_size, **self.distances)
        if not self.recipe.rise or len(angles_deg) != self.recipe.views:
            return views
        vectors = views.vectors.copy()
        vectors[:, 5] -= self.rise
        if self.beam == "cone":
            vectors[:, 2] -= self.rise
        return Geometry(vectors, views.shape, views.beam)

    @property
    def rise(self) -> Float:
        """Height of the stage in each view of the full scan, mm."""
        return np.linspace(0, self.recipe.rise, self.recipe.views)

    @cached_property
    def sample(self) -> Sample:
        """In the reference state."""
        recipe, draws = self.recipe, self.draws
        rng = np.random.default_rng(recipe.seed)
        mu = draws["attenuation"]
        if recipe.cubes is not None:
            shape = polyhedron(CUBE * CUBE_EDGE / 2 * VOXEL)
            turns = [rotation_matrix(rng.normal(size=3)) for _ in CUBE_PLACES]
            return Sample(
                tuple(Particle(shape.moved(r, CUBE_SPACING * VOXEL * p), mu) for r, p in zip(turns, CUBE_PLACES))
            )
        packed = packed_stones(recipe.seed, int(draws["stones"]), float(draws["diameter"]), recipe.size_spread)
        shares = [recipe.faint if k % 3 == 2 else 1.0 for k in range(len(packed))]
        return Sample(tuple(Particle(p.shape, mu * share) for p, share in zip(packed.particles, shares)))

    @cached_property
    def truth(self) -> Motions:
        """True motions to the later state."""
        seed = self.recipe.seed + 1
        if self.recipe.cubes is None:
            return motion_fields.random(self.sample, MAX_MOTION[0] * VOXEL, MAX_MOTION[1], seed)
        still = motion_fields.random(self.sample, MAX_MOTION[0] * VOXEL, 0.0, seed)
        axis = np.random.default_rng(seed).normal(size=3)
        vector = np.deg2rad(self.recipe.cubes) * axis / np.linalg.norm(axis)
        return replace(still, rotations=np.tile(vector, (len(still), 1)))

    @cached_property
    def physics(self) -> Physics:
        """Beam and detector."""
        return Physics(
            photons=self.recipe.photons,
            dark=100,
            dark_noise=2,
            flat_variation=0.02,
            flats=10,
            darks=10,
            subsamples=2,
            detector_seed=self.recipe.seed,
        )

    def grid(self) -> Volume:
        """The voxels told."""
        return Volume.zeros((PANEL[0], PANEL[1], PANEL[1]), VOXEL)


@PAGE.cached(*SIMULATION)
def packed_stones(seed: int, count: int, diameter: float, size_spread: float) -> Sample:
    """Stones in a cylinder; kept on disk."""
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(STONE_SHAPES)[:count]
    spread = 1 + size_spread * rng.uniform(-1, 1, count)
    stones = [Particle(stone(int(k), diameter * VOXEL * s, 3), 1.0) for k, s in zip(chosen, spread)]
    return pack(stones, PackingSettings(RADIUS * VOXEL, drops=4, moves=600), seed)


def surrounded(sample: Sample, around: str) -> Sample:
    """A sample in a cell, or between two platens."""
    attenuation = sample.particles[0].attenuation
    if around == "cell":
        return Sample(sample.particles, Tube((RADIUS + 4) * VOXEL, (RADIUS + 6) * VOXEL, 0.3 * attenuation))
    if around == "platens":
        angles = np.arange(24) * np.pi / 12
        ring = RADIUS * VOXEL * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        plates = tuple(
            Particle(
                polyhedron(np.concatenate([np.column_stack([ring, np.full(24, z * VOXEL)]) for z in ends])), attenuation
            )
            for ends in ((-32, -26), (26, 32))
        )
        return Sample(sample.particles + plates)
    return sample


@dataclass(frozen=True, eq=False)
class Images:
    """Counts of a laboratory, row 0 at the bottom."""

    reference: Counts
    state: Counts
    flats: Counts
    darks: Counts


@PAGE.cached(*SIMULATION)
def _recorded(recipe: Recipe) -> tuple[Counts, Counts, Counts, Counts]:
    """Both states; kept on disk, as many inputs are made of them."""
    lab = Laboratory(recipe)
    full = record(surrounded(lab.sample, recipe.around), lab.geometry(lab.angles_deg), lab.physics, recipe.seed)
    moved = surrounded(lab.sample.moved(lab.truth), recipe.around)
    later = record(moved, lab.geometry(lab.state_angles_deg), lab.physics, recipe.seed + 1000, recipe.state_beam)
    return tuple(_rounded(a) for a in (full.counts, later.counts, full.flats, full.darks))  # type: ignore[return-value]


def strangers(recipe: Recipe) -> Counts:
    """Radiographs of another sample, in the scanner and at the views of the later state of a recipe."""
    lab, other = laboratory(recipe), laboratory(replace(recipe, seed=recipe.seed + OTHER_SEED))
    shot = record(other.sample, lab.geometry(lab.state_angles_deg), lab.physics, recipe.seed + 2000)
    return _rounded(shot.counts)


def _rounded(counts: NDArray[np.float32]) -> Counts:
    return np.clip(np.rint(counts), 0, np.iinfo(np.uint16).max).astype(np.uint16)


@lru_cache(maxsize=8)
def images(recipe: Recipe) -> Images:
    """Radiographs of a recipe."""
    return Images(*_recorded(recipe))


@lru_cache(maxsize=8)
def laboratory(recipe: Recipe) -> Laboratory:
    """The laboratory of a recipe; its sample is packed once."""
    return Laboratory(recipe)


@lru_cache(maxsize=4)
@PAGE.cached(*SIMULATION)
def true_volume(recipe: Recipe) -> tuple[NDArray[np.float32], NDArray[np.int16]]:
    """Attenuation and labels on the voxels, as other software would leave them: noisy, slightly blurred."""
    lab = laboratory(recipe)
    exact = attenuation_volume(lab.sample, lab.grid()).array
    noise = np.random.default_rng([recipe.seed, 3]).normal(0, 0.03 * exact.max(), exact.shape)
    return (exact + noise).astype(np.float32), label_volume(lab.sample, lab.grid())
