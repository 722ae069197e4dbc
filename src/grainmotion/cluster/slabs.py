"""What workers do of a reconstruction: `reconstructing.slabs` as pure tasks, which Dask may do again, and files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from grainmotion.cluster.spare import copied
from grainmotion.cluster.threads import own_threads
from grainmotion.experiment.scans import ScanInput
from grainmotion.geometry import Geometry
from grainmotion.packed import Image
from grainmotion.reconstructing import slabs
from grainmotion.reconstructing.accelerated import coarse_start
from grainmotion.reconstructing.coarser import COARSER
from grainmotion.reconstructing.equations import Float, Views
from grainmotion.reconstructing.slabs import Corrections, Layout, Rows, Seen, Slab, Strip
from grainmotion.scan import Scan, binned, views_for

AT_ONCE = 32
"""Views that are read at once for a coarse start."""


# ---------------------------------------------------------------------- radiographs
def load_views(source: ScanInput, views: Views) -> Scan:
    """Read some views from the files."""
    return source.select(views).read()[0]


def rows_of(scan: Scan, rows: Rows) -> Seen:
    """Some rows of radiographs."""
    images = scan.line_integrals[:, slice(*rows)].astype(np.float32)
    return Seen(rows[0], images, None if scan.valid is None else scan.valid[:, slice(*rows)].copy())


def coarse(source: ScanInput, layout: Layout) -> Image:
    """A start on coarser voxels (see `accelerated`), from the files."""
    columns = layout.geometry.shape[1] // COARSER
    chosen = views_for(len(layout.geometry), columns)
    parts = [chosen[k : k + AT_ONCE] for k in range(0, len(chosen), AT_ONCE)]
    with own_threads():
        return coarse_start(joined([binned_alone(load_views(source, part)) for part in parts]), layout, layout.settings)


def binned_alone(scan: Scan) -> Scan:
    """`binned`, each view by itself, none left out."""
    return joined([binned(scan.select([k]), COARSER) for k in range(len(scan))])


def joined(scans: list[Scan]) -> Scan:
    """The views of all of them."""
    first = scans[0].geometry
    geometry = Geometry(np.concatenate([s.geometry.vectors for s in scans]), first.shape, first.beam)
    images, valid = np.concatenate([s.line_integrals for s in scans]), None
    if any(s.valid is not None for s in scans):
        valid = np.concatenate([np.ones(s.line_integrals.shape, bool) if s.valid is None else s.valid for s in scans])
    return Scan(images, geometry, valid)


# ---------------------------------------------------------------------- slabs
def new_slab(layout: Layout, number: int) -> Slab:
    """A slab of zeros."""
    return slabs.new_slab(layout, number, _zeros(layout, number))


def slab_from(layout: Layout, rough: Image, number: int) -> Slab:
    """A slab of a coarse start."""
    with own_threads():
        return slabs.slab_from(layout, number, _zeros(layout, number), rough)


def _zeros(layout: Layout, number: int) -> Image:
    first, end = layout.slabs[number]
    return np.zeros((end - first, *layout.shape[1:]), np.float32)


def forward(slab: Slab, views: Views) -> Strip:
    """Its line integrals in some views."""
    with own_threads():
        return slabs.forward(slab, views)


def compare(
    layout: Layout, parts: list[Strip], groups: list[Seen], views: Views, picks: list[Views], step: float
) -> Corrections:
    """Corrections of some views: ``picks`` of each of the groups, in their order, times ``step``."""
    images = np.concatenate([group.images[pick] for group, pick in zip(groups, picks, strict=True)])
    valid = None
    if any(group.valid is not None for group in groups):
        valid = np.concatenate(
            [
                np.ones((len(pick), *group.images.shape[1:]), bool) if group.valid is None else group.valid[pick]
                for group, pick in zip(groups, picks, strict=True)
            ]
        )
    with own_threads():
        return slabs.compare(layout, views, parts, Seen(groups[0].first, images, valid), step)


def squares_of(corrections: Corrections) -> Float:
    """The two sums of squares of each row before an update."""
    return corrections.squares


def advance(slab: Slab, corrections: Corrections, views: Views, momentum: float) -> Slab:
    """The slab after an update; the one given stays as it is, for its line integrals may be asked for again."""
    before = slab.before
    if momentum:
        before = copied(slab.image if before is None else before)
    slab = replace(slab, image=copied(slab.image), before=before)
    with own_threads():
        slabs.advance(slab, corrections, views, momentum)
    return slab


# ---------------------------------------------------------------------- to storage and back
def store(slab: Slab, path: Path) -> None:
    """Put what a slab holds into a file."""
    with path.open("wb") as file:
        for image in (slab.image, slab.before):
            if image is not None:
                np.save(file, image)


def restored(layout: Layout, number: int, path: Path, momentum: float) -> Slab:
    """A slab that was stored, with or without momentum."""
    imaging = slabs.imaging_of(layout, number, _zeros(layout, number))
    with path.open("rb") as file:
        return Slab(imaging, layout.shaded[number][0], np.load(file), np.load(file) if momentum else None)


def store_planes(slab: Slab, path: Path) -> None:
    """Put the planes as they were last constrained into a file, ``[z, y, x]``."""
    np.save(path, np.ascontiguousarray(slab.planes))
