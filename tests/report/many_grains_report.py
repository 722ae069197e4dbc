"""Reports of many star-shaped grains with known motions in several states, for tests and benchmarks of the page.

A sample in a cylinder is pressed together along z: grains move with a smooth field, turn within an inclined band, and
are shifted as a whole.  Every status occurs from 40 grains on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions, Status
from grainmotion.model.state_fit import StateFit
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData, StateReport
from grainmotion.rotations import rotation_matrix

VOXEL_SIZE = 0.1  # mm
REASONS = {
    Status.POORLY_DETERMINED: "poorly determined: rotation about z; add a view from another side",
    Status.NOT_CONVERGED: "the fit stopped after 30 iterations; give it a better start",
    Status.AMBIGUOUS: "two orientations fit as well; the grain looks the same from both sides",
    Status.LEFT_FIELD: "its centre left the field of view",
}
NO_MOTION = (Status.LEFT_FIELD, Status.NOT_FITTED, Status.ABSENT)
UNUSUAL = tuple(status for status in Status if status != Status.CONVERGED)


@dataclass(frozen=True, eq=False)
class Packing:
    """Labels on voxels, centres (mm) and the radius of a ball of typical size (mm)."""

    labels: NDArray[np.int32]
    volume: Volume
    centers: Float
    radius: float


def packing(n: int, across: int, seed: int = 0) -> Packing:
    """``n`` star-shaped grains of about ``across`` voxels, in a cylinder half as high again as it is wide."""
    rng = np.random.default_rng(seed)
    places = _places(n, rng) * 0.94 * across
    low = places.min(axis=0) - 0.8 * across
    shape = tuple(np.ceil(places.max(axis=0) + 0.8 * across - low).astype(int)[::-1])
    labels = np.zeros(shape, np.int32)
    for label, place in enumerate(places - low, start=1):
        _paint(labels, label, place, across, rng)
    array = np.where(labels > 0, np.float32(0.5), np.float32(0.01))
    volume = Volume(array, VOXEL_SIZE)
    centers = (places - low) * VOXEL_SIZE + volume.origin
    return Packing(labels, volume, centers, across * VOXEL_SIZE / 2)


def motions(packed: Packing, strength: float, seed: int = 1) -> Motions:
    """Motions of the grains after a compression by ``strength`` times 10 %."""
    rng, x = np.random.default_rng(seed), packed.centers
    n, size = len(x), float(np.ptp(x[:, 2])) + 2 * packed.radius
    z = x[:, 2] - x[:, 2].min()
    band = np.exp(-(((x[:, 2] - 0.8 * x[:, 0]) / (0.12 * size)) ** 2))
    u = strength * np.stack([0.05 * x[:, 0] + 0.02 * size, 0.05 * x[:, 1], -0.1 * z], axis=1)
    u += strength * 0.02 * packed.radius * rng.normal(size=(n, 3))
    turns = strength * np.deg2rad(rng.normal(0, 2, (n, 3)) + band[:, None] * np.array([0.0, 25.0, 0.0]))
    statuses = np.full(n, Status.CONVERGED.value, dtype="<U20")
    for k, status in enumerate(UNUSUAL):  # one grain each in forty; of six grains two
        statuses[np.arange(n) % 40 == 4 * k + 3] = status.value
    u[np.isin(statuses, NO_MOTION)] = turns[np.isin(statuses, NO_MOTION)] = np.nan
    return replace(
        Motions.identity(np.arange(1, n + 1), x),
        translations=u, rotations=turns, covariances=_covariances(statuses, packed.radius, rng),
        statuses=statuses, residuals=rng.gamma(9, 0.002, n), iterations=rng.integers(4, 20, n),
        reasons=tuple(REASONS.get(Status(s), "" if s == "converged" else f"it is {s}; look at it") for s in statuses),
        fit=StateFit(1.003, -0.001, (("whole sample", 0.4), ("all grains", 0.1), ("all grains", 0.03))),
    )  # fmt: skip


def many_grains_report(n: int, states: int = 3, across: int | None = None, views: int = 2) -> ReportData:
    """A report of ``n`` grains and several states; ``across`` is the size of a grain in voxels."""
    packed = packing(n, across or (32 if n <= 50 else 18 if n <= 1000 else 12))
    reports = []
    for k in range(states):
        moved = motions(packed, (k + 1) / states, seed=k + 1)
        measured, simulated, geometry = _radiographs(packed, moved, views, seed=k)
        reports.append(StateReport(f"load-{k + 1:02d}", measured, simulated, moved, VOXEL_SIZE, geometry=geometry))
    return ReportData(
        title=f"{n} stones under load",
        facts=(("Grains", str(n)), ("Voxel size", f"{VOXEL_SIZE} mm")),
        reconstruction_errors=(0.3, 0.1, 0.05),
        volume=packed.volume,
        labels=packed.labels,
        states=tuple(reports),
        findings=(
            Finding(Level.WARNING, "gain", "state load-01", "view 1 is darker", "gain 0.93", "check its flat field"),
        ),
    )


def _places(n: int, rng: np.random.Generator) -> Float:
    """``n`` places in a cylinder about the z axis, about a unit apart: a dense lattice, a little disturbed."""
    reach = int(np.ceil((6 * n) ** (1 / 3))) + 3
    steps = np.mgrid[-reach : reach + 1, -reach : reach + 1, -reach : reach + 1].reshape(3, -1).T
    lattice = steps @ np.array([[1, 0, 0], [0.5, 0.866, 0], [0.5, 0.289, 0.816]])
    far = np.maximum(np.hypot(lattice[:, 0], lattice[:, 1]), np.abs(lattice[:, 2]) / 1.5)
    chosen = lattice[np.argsort(far, kind="stable")[:n]]
    chosen = chosen[np.lexsort(chosen.T)]
    return chosen + rng.uniform(-0.06, 0.06, chosen.shape)


def _paint(labels: NDArray[np.int32], label: int, place: Float, across: int, rng: np.random.Generator) -> None:
    """Paint a star-shaped body where nothing is yet: an ellipsoid with bumps."""
    half = round(0.75 * across)
    first = np.round(place).astype(int) - half
    first = np.maximum(first, 0)
    box = tuple(slice(a, a + 2 * half + 1) for a in first[::-1])
    view = labels[box]
    z, y, x = np.indices(view.shape)
    offsets = np.stack([x, y, z], axis=-1) + first - place
    axes = rotation_matrix(rng.normal(size=3))
    local = offsets @ axes / (np.array([1.15, 1.0, 0.87]) * across / 2)
    distance = np.linalg.norm(local, axis=-1)
    directions = local / np.maximum(distance, 1e-9)[..., None]
    bumps = rng.normal(size=(4, 3))
    radius = 1 + 0.09 * sum(np.sin(2.2 * directions @ bump + k) for k, bump in enumerate(bumps))
    view[(distance < radius) & (view == 0)] = label


def _covariances(statuses: NDArray[np.str_], radius: float, rng: np.random.Generator) -> Float:
    """Covariances ``(n, 6, 6)``, mm and radians; those of poorly determined grains are long about one axis."""
    n = len(statuses)
    sd = rng.uniform(0.5, 1.5, (n, 6)) * np.repeat([0.004 * radius, 0.006], 3)
    sd[statuses == Status.POORLY_DETERMINED.value, 5] = 0.4
    frames = rotation_matrix(0.3 * rng.normal(size=(n, 3)))
    whole = np.zeros((n, 6, 6))
    whole[:, :3, :3] = whole[:, 3:, 3:] = frames
    out = np.einsum("nij,nj,nkj->nik", whole, sd**2, whole)
    out[np.isin(statuses, NO_MOTION)] = np.nan
    return np.asarray(out)


def _radiographs(packed: Packing, moved: Motions, views: int, seed: int) -> tuple[Float, Float, Geometry]:
    """Parallel views of balls at the moved places, with noise and without ``(views, rows, columns)``."""
    rng, pixel = np.random.default_rng(seed), VOXEL_SIZE * max(1, round(packed.radius / VOXEL_SIZE / 8))
    places = packed.centers + np.nan_to_num(moved.translations)
    half = int(np.ceil(packed.radius / pixel))
    rows = int(np.ptp(places[:, 2]) / pixel) + 4 * half
    columns = int(2 * np.hypot(places[:, 0], places[:, 1]).max() / pixel) + 4 * half
    v, u = np.mgrid[-half : half + 1, -half : half + 1]
    chord = 2 * np.sqrt(np.maximum(packed.radius**2 - (u**2 + v**2) * pixel**2, 0)) * 0.5
    images, angles = np.zeros((views, rows, columns)), np.pi * np.arange(views) / views
    for image, angle in zip(images, angles):
        across = places[:, 0] * np.cos(angle) + places[:, 1] * np.sin(angle)
        column = np.round(across / pixel).astype(int) + columns // 2
        row = np.round((places[:, 2] - places[:, 2].min()) / pixel).astype(int) + 2 * half
        np.add.at(image, (row[:, None, None] + v, column[:, None, None] + u), chord)
    sides, up = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), np.array([0.0, 0.0, 1.0])
    beams = np.stack([-np.sin(angles), np.cos(angles), 0 * angles], axis=1)
    lowest = places[:, 2].min() + ((rows - 1) / 2 - 2 * half) * pixel
    middles = sides * ((columns - 1) / 2 - columns // 2) * pixel + up * lowest
    vectors = np.hstack([beams, middles, sides * pixel, np.tile(up * pixel, (views, 1))])
    geometry = Geometry(vectors, (rows, columns), "parallel")
    return images + rng.normal(0, 0.01 * images.max(), images.shape), images, geometry
