"""Planar samples like the paper's Fig. 3: 30 grains of about 30 pixels, with real shapes and grey levels.

Outlines are sections of real gravel stones through their centres, in random orientations; grey levels are
patches of a photograph of gravel (Rob Tuytel, CC0; in scikit-image), scaled to the spread ``CONTRAST``.
No two grains touch.  A length of 1 is a pixel and a voxel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation
from skimage import data

from grainmotion._typing import Projector
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import stone_radius
from validation.paper.page import Section, figure

Float = NDArray[np.float64]

STONE_COUNT = 95
DIAMETER = 30.0  # of the circle of the same area, on average
GAP_PIXELS = 3  # pixels of air around each grain at least
ATTENUATION, CONTRAST = 0.02, 0.15  # mean, per pixel; relative standard deviation of the grey levels
IMAGE_SIZE = 384
SETS = ("one", "loose", "dense", "all")
VIEWS_DEG = {n: tuple(22.5 + 180.0 * np.arange(n) / n) for n in (2, 4, 6)}
PANEL = (1, 420)


@dataclass(frozen=True, eq=False)
class Image:
    """A planar sample: its attenuation and its labels, both ``(rows along y, columns along x)``."""

    attenuation: Float
    labels: NDArray[np.int64]

    def grains(self, which: str = "all") -> GrainSet:
        """The grains of one of `SETS`, in double precision, on a volume one voxel thick."""
        labels = self.labels.copy()
        labels[~np.isin(labels, self.members(which))] = 0
        volume = Volume(self.attenuation[None], 1.0)
        return grains_from_labels(volume, labels[None], reach=0)

    def members(self, which: str) -> list[int]:
        """Labels of the innermost grain; of six about two diameters distances; of six neighbours; or of all."""
        numbers = np.arange(1, self.labels.max() + 1)
        if which == "all":
            return numbers.tolist()
        places = np.array(ndimage.center_of_mass(np.ones_like(self.labels), self.labels, numbers))
        order = np.argsort(np.hypot(*(places - (IMAGE_SIZE - 1) / 2).T))
        if which == "one":
            return [int(numbers[order[0]])]
        distances = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
        if which == "dense":
            return sorted(numbers[np.argsort(distances[order[0]])[:6]].tolist())
        return sorted(numbers[_spread(distances, order, 6, 2 * DIAMETER)].tolist())


def draw(seed: int) -> Image:
    """The sample of a seed: grains slide one after the other towards the middle until others stop them."""
    rng = np.random.default_rng(seed)
    attenuation, labels = np.zeros((IMAGE_SIZE, IMAGE_SIZE)), np.zeros((IMAGE_SIZE, IMAGE_SIZE), np.int64)
    for label, index in enumerate(rng.permutation(STONE_COUNT)[:30], start=1):
        share = _section(rng, int(index))
        shade = _texture(rng, share.shape) * share
        row, column = _resting_place(rng, labels > 0, share > 0)
        box = (slice(row, row + len(share)), slice(column, column + len(share)))
        attenuation[box] += ATTENUATION * shade
        labels[box][share > 0] = label
    return Image(attenuation, labels)


def geometry(views: int) -> Geometry:
    """Parallel views evenly over 180°, the first at 22.5°."""
    return Geometry.parallel(VIEWS_DEG[views], PANEL, 1.0)


def small_motions(grains: GrainSet, seed: int) -> Motions:
    """Table 1: |u| ≤ 1 pixel a component, |ω| ≤ 6°, uniform."""
    rng = np.random.default_rng([seed, 1])
    return _motions(grains, rng.uniform(-1, 1, (len(grains), 2)), rng.uniform(-6, 6, len(grains)))


def large_motions(grains: GrainSet, seed: int) -> Motions:
    """Table 2: u = 0.15 x across, 0.1 y along, |ω| ≤ 30° uniform."""
    rng = np.random.default_rng([seed, 2])
    return _motions(grains, grains.centers[:, :2] * (0.15, 0.10), rng.uniform(-30, 30, len(grains)))


def observe(grains: GrainSet, truth: Motions, views: int, projector: Projector = "trilinear") -> Scan:
    """Radiographs of moved grains without noise, made as the paper does by the tracker's own projector."""
    view_geometry = geometry(views)
    return Scan(simulate_radiographs(grains, truth, view_geometry, projector=projector), view_geometry)


def errors(measured: Motions, truth: Motions) -> Float:
    """Largest error of each grain, ``(n, 2)``: of (u_x, u_y) in pixels, of ω in radians."""
    shift = np.abs(measured.translations - truth.translations)[:, :2].max(axis=1)
    rotation = measured.rotations[:, 2] - truth.rotations[:, 2]
    return np.stack([shift, np.abs(np.arctan2(np.sin(rotation), np.cos(rotation)))], axis=1)


def study() -> Section:
    """Three realisations, with their sets."""
    image = Figure(figsize=(12, 4.3))
    for seed, axes in enumerate(image.subplots(1, 3)):
        sample = draw(seed)
        axes.imshow(sample.attenuation, cmap="gray", origin="lower")
        for which, colour in (("loose", "C0"), ("dense", "C1"), ("one", "C3")):
            chosen = np.isin(sample.labels, sample.members(which))
            axes.contour(chosen, levels=[0.5], colors=colour, linewidths=1.2)
        axes.set_title(f"seed {seed}")
        axes.set_axis_off()
    caption = "Planar samples: all 30 grains; blue the loose set, orange the dense set, red the grain that is alone."
    text = f"""The paper's Fig. 3 shows 30 grains of a real slice.  Here every seed draws another sample: outlines are
sections of 30 of 95 real gravel stones, about {DIAMETER:.0f} pixels across; grey levels are patches of a photograph
of gravel, with a standard deviation of {CONTRAST:.0%} of the mean; at least {GAP_PIXELS} pixels lie between grains.

{figure("images", image, caption)}"""
    return Section("Planar samples (Fig. 3)", text)


# ---------------------------------------------------------------------- drawing
@cache
def _photograph() -> Float:
    """The photograph at half its size, slow shading removed, of zero mean and unit spread."""
    picture = data.gravel().astype(float)
    picture = picture.reshape(256, 2, 256, 2).mean(axis=(1, 3))
    picture -= ndimage.gaussian_filter(picture, 12)
    return (picture - picture.mean()) / picture.std()


def _texture(rng: np.random.Generator, shape: tuple[int, ...]) -> Float:
    picture = _photograph()
    row, column = (rng.integers(0, whole - part + 1) for whole, part in zip(picture.shape, shape, strict=True))
    patch = np.rot90(picture, rng.integers(4))[row : row + shape[0], column : column + shape[1]]
    return np.clip(1 + CONTRAST * patch, 0.3, 1.7)


def _section(rng: np.random.Generator, index: int) -> Float:
    """Share of each pixel that a stone's section covers, on a square just large enough."""
    angles = np.linspace(-np.pi, np.pi, 181)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    radii = stone_radius(index, Rotation.random(random_state=rng).apply(ring))
    radii *= DIAMETER / 2 * rng.uniform(0.9, 1.1) / np.sqrt((radii**2).mean())
    half = int(np.ceil(radii.max())) + 1
    fine = (np.arange((2 * half + 1) * 5) + 0.5) / 5 - (2 * half + 1) / 2
    y, x = np.meshgrid(fine, fine, indexing="ij")
    inside = np.hypot(x, y) <= np.interp(np.arctan2(y, x), angles, radii)
    return inside.reshape(2 * half + 1, 5, 2 * half + 1, 5).mean(axis=(1, 3))


def _resting_place(rng: np.random.Generator, taken: NDArray[np.bool_], shape: NDArray[np.bool_]) -> tuple[int, int]:
    """First row and column of a grain that slid from outside towards the middle, `GAP_PIXELS` from all others."""
    distance = ndimage.distance_transform_edt(~taken) if taken.any() else np.full(taken.shape, np.inf)
    half, best = len(shape) // 2, (np.inf, 0, 0)
    for angle in rng.uniform(0, 2 * np.pi, 12):  # the deepest of some slides, so that the heap is round
        place = None
        for radius in np.arange(IMAGE_SIZE / 2 - half - 1, -1, -1.0):
            row, column = (round((IMAGE_SIZE - 1) / 2 + radius * float(f(angle))) - half for f in (np.sin, np.cos))
            under = distance[row : row + len(shape), column : column + len(shape)][shape]
            if under.min() <= GAP_PIXELS:
                break
            place = (radius, row, column)
        if place is not None and place[0] < best[0]:
            best = place
    if not np.isfinite(best[0]):
        raise ValueError("a grain found no place; draw another seed")
    return int(best[1]), int(best[2])


def _spread(distances: Float, order: NDArray[np.int64], count: int, distance: float) -> NDArray[np.int64]:
    """``count`` grains about ``distance`` from the nearest other one of them, the first the innermost."""
    chosen = [int(order[0])]
    while len(chosen) < count:
        nearest = distances[chosen].min(axis=0)
        nearest[chosen] = np.inf
        chosen.append(int(np.argmin(np.abs(nearest - distance))))
    return np.array(chosen)


def _motions(grains: GrainSet, shifts: Float, rotations_deg: Float) -> Motions:
    truth = Motions.identity(grains.labels, grains.centers)
    truth.translations[:, :2] = shifts
    truth.rotations[:, 2] = np.deg2rad(rotations_deg)
    return truth
