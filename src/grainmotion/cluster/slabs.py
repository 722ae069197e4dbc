"""What workers do of a reconstruction: plain functions from nouns to nouns that know no Dask.

The volume lies with the workers in slabs along z, the radiographs view by view.  A projection is linear in the
volume, so the line integrals of the whole are the sum of those of its slabs, and a slab of the adjoint needs its own
rows of the corrections only:

    forward of each slab ── compare (where the radiographs are) ── adjoint to each slab ── constrain it

What travels are rows of the radiographs of one subset of views.  Sharing out the views instead would send the
whole volume to and fro with every subset (decision 0013).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster.threads import own_threads
from grainmotion.experiment.scans import ScanInput
from grainmotion.geometry import Geometry
from grainmotion.packed import Image
from grainmotion.reconstructing.accelerated import COARSER, coarse_start, finer
from grainmotion.reconstructing.equations import Frame, Imaging, Views
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.scan import Scan, binned, views_for
from grainmotion.volume import Volume

Float = NDArray[np.float64]

THICKNESS = 128
"""Planes of a slab, about: thinner ones see many rows of pixels in common."""
MARGIN = 0.55
"""Voxels beyond its faces that a slab shades: it is interpolated up to the next voxel's middle."""
RING = 48
"""Points of the ring of which a slab's upright cylinder is taken to be made."""
AT_ONCE = 32
"""Views that are read at once for a coarse start."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A grid without its values: how it is cut, and what sees it."""

    shape: tuple[int, int, int]
    voxel_size: float
    center: tuple[float, float, float]
    geometry: Geometry
    settings: ReconstructSettings

    @property
    def slabs(self) -> list[tuple[int, int]]:
        """First plane of each slab and the plane after its last; they follow from the grid alone."""
        planes = self.shape[0]
        count = min(planes, max(2, round(planes / THICKNESS)))
        ends = np.round(np.linspace(0, planes, count + 1)).astype(int)
        return [(int(a), int(b)) for a, b in pairwise(ends)]

    def center_of(self, slab: tuple[int, int]) -> tuple[float, float, float]:
        """Middle of a slab, mm."""
        x, y, z = self.center
        return x, y, z + self.voxel_size * ((slab[0] + slab[1]) - self.shape[0]) / 2

    def rows_of(self, slab: tuple[int, int]) -> tuple[int, int]:
        """Rows of pixels that a slab may shade in any view."""
        _, ny, nx = self.shape
        turn = 2 * np.pi * np.arange(RING) / RING
        radius = (min(nx, ny) if self.settings.circular else np.hypot(nx, ny)) / 2 + 1.5
        ring = radius / np.cos(np.pi / RING) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        height = (slab[1] - slab[0]) / 2 + MARGIN
        rim = np.concatenate([np.c_[ring, np.full(RING, side * height)] for side in (-1, 1)])
        spots = self.geometry.project_points(rim * self.voxel_size + self.center_of(slab))[..., 0]
        rows = self.geometry.shape[0]
        if not np.isfinite(spots).all():  # a source beside or in the volume
            return 0, rows
        first = int(np.clip(np.floor(spots.min()), 0, rows - 1))
        return first, int(np.clip(np.ceil(spots.max()) + 1, first + 1, rows))


@dataclass(frozen=True, eq=False)
class Slab:
    """Some planes of the volume: their image, and that of the time before; `imaging` sees rows ``first …`` only."""

    imaging: Imaging
    first: int
    image: Image
    before: Image

    @property
    def rows(self) -> slice:
        """Rows of pixels that it may shade."""
        return slice(self.first, self.first + self.imaging.geometry.shape[0])


@dataclass(frozen=True, eq=False)
class Strip:
    """Line integrals ``(views, rows, columns)`` of a slab, from row ``first`` on."""

    first: int
    images: Image


@dataclass(frozen=True, eq=False)
class Corrections:
    """What is to be projected back ``(views, rows, columns)``; Σ(b − A x)² and Σb² before it."""

    images: Image
    squares: Float


# ---------------------------------------------------------------------- radiographs
def load_views(source: ScanInput, views: Views) -> Scan:
    """Read some views from the files."""
    return source.select(views).read()[0]


def coarse(source: ScanInput, layout: Layout) -> Image:
    """A start on coarser voxels (see `accelerated`), from the files."""
    columns = layout.geometry.shape[1] // COARSER
    chosen = views_for(len(layout.geometry), columns)
    parts = [chosen[k : k + AT_ONCE] for k in range(0, len(chosen), AT_ONCE)]
    scans = [binned_alone(load_views(source, part)) for part in parts]
    masks = [np.ones(s.line_integrals.shape, bool) if s.valid is None else s.valid for s in scans]
    whole = np.concatenate(masks)
    vectors = np.concatenate([s.geometry.vectors for s in scans])
    rough = Scan(
        np.concatenate([s.line_integrals for s in scans]),
        replace(scans[0].geometry, vectors=vectors),
        None if whole.all() else whole,
    )
    grid = Volume(np.broadcast_to(np.float32(0), layout.shape), layout.voxel_size, layout.center)
    with own_threads():
        return coarse_start(rough, grid, layout.settings)


def binned_alone(scan: Scan) -> Scan:
    """`binned`, each view by itself, none left out."""
    views = [binned(scan.select([k]), COARSER) for k in range(len(scan))]
    valid = None if scan.valid is None else np.concatenate([v.valid for v in views if v.valid is not None])
    vectors = np.concatenate([v.geometry.vectors for v in views])
    images = np.concatenate([v.line_integrals for v in views])
    return Scan(images, replace(views[0].geometry, vectors=vectors), valid)


# ---------------------------------------------------------------------- slabs
def new_slab(layout: Layout, number: int, rough: Image | None = None) -> Slab:
    """A slab of zeros, or of a coarse start."""
    planes = layout.slabs[number]
    first, end = layout.rows_of(planes)
    shape = (planes[1] - planes[0], *layout.shape[1:])
    array = np.zeros(shape, np.float32) if rough is None else finer(rough, layout.shape, slice(*planes))
    grid = Volume(array, layout.voxel_size, layout.center_of(planes))
    window = layout.geometry.window((first, 0), (end - first, layout.geometry.shape[1]))
    imaging = Imaging(window, grid, layout.settings)
    image = imaging.start()
    if rough is not None:
        imaging.constrain(image)
    return Slab(imaging, first, image, image.copy())


def forward(slab: Slab, views: Views) -> Strip:
    """Its line integrals in some views."""
    with own_threads():
        return Strip(slab.first, slab.imaging.operator.forward(slab.image, views))


def compare(parts: list[Strip], scans: list[Scan], picks: list[Views], frame: Frame, step: float) -> Corrections:
    """Corrections of some views: ``picks`` of each of the scans, in their order, times ``step``."""
    chosen = [scan.select(pick) for scan, pick in zip(scans, picks, strict=True)]
    views, shape = sum(map(len, chosen)), chosen[0].geometry.shape
    sums = np.zeros((views, *shape))
    for part in parts:
        sums[:, part.first : part.first + part.images.shape[1]] += part.images
    images = sums.astype(np.float32)
    squares, at = np.zeros(2), 0
    with own_threads():
        for scan in chosen:
            squares += frame.compare(images[at : at + len(scan)], scan)
            at += len(scan)
    images *= np.float32(step)
    return Corrections(images, squares)


def squares_of(corrections: Corrections) -> Float:
    """The two sums of squares."""
    return corrections.squares


def adjoint(slab: Slab, corrections: Corrections, views: Views) -> Slab:
    """The slab with the corrections of some views projected back."""
    image = slab.image.copy()
    with own_threads():
        slab.imaging.operator.add_adjoint(corrections.images[:, slab.rows], image, views)
    return replace(slab, image=image)


def constrain(slab: Slab) -> Slab:
    """See `Iterate.constrain`."""
    image = slab.image.copy()
    with own_threads():
        slab.imaging.constrain(image)
    return replace(slab, image=image, before=image)


def constrain_and_extrapolate(slab: Slab, momentum: float) -> Slab:
    """See `Iterate.constrain_and_extrapolate`."""
    image, before = slab.image.copy(), slab.before.copy()
    with own_threads():
        slab.imaging.constrain_and_extrapolate(image, before, momentum)
    return replace(slab, image=image, before=before)


# ---------------------------------------------------------------------- to storage and back
def store(slab: Slab, path: Path) -> Path:
    """Put both images into a file."""
    np.save(path, np.stack([slab.image, slab.before]))
    return path


def restored(layout: Layout, number: int, path: Path) -> Slab:
    """A slab that was stored."""
    image, before = np.load(path)
    return replace(new_slab(layout, number), image=image, before=before)


def store_planes(slab: Slab, path: Path) -> Path:
    """Put the planes as they were last constrained into a file, ``[z, y, x]``."""
    np.save(path, slab.imaging.operator.unlaid(slab.before))
    return path
