"""Tasks of a reconstruction: `reconstruction.slabs` as pure functions, which Dask may run again, and files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.cluster.buffer_pool import pooled_copy
from grainmotion.cluster.worker_threads import use_worker_threads
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.preprocessing.binning import binned_scan
from grainmotion.reconstruction import slabs
from grainmotion.reconstruction.coarse_start import COARSENING, Piece, coarse_start, finer_slab
from grainmotion.reconstruction.slabs import Layout, RadiographRows, Rows, Slab, Strip
from grainmotion.reconstruction.system import Views


@dataclass(frozen=True, eq=False)
class Update:
    """An update of the volume by some views.

    Attributes
    ----------
    views : int array
    picks : list of int arrays
        Their rows in each group of views that was read at once.
    step : float
        Relaxation over the column sums of these views.
    momentum : float
    """

    views: Views
    picks: list[Views]
    step: float
    momentum: float


# ---------------------------------------------------------------------- radiographs
def load_views(source: ScanInput, views: Views) -> Scan:
    """Read some views from the files."""
    return source.select(views).read()[0]


def rows_of(scan: Scan, rows: Rows) -> RadiographRows:
    """Some rows of radiographs."""
    images = scan.line_integrals[:, slice(*rows)].astype(np.float32)
    return RadiographRows(rows[0], images, None if scan.valid is None else scan.valid[:, slice(*rows)].copy())


def handed(rows: RadiographRows) -> RadiographRows:
    """The same rows, copied to the worker that needs them."""
    return rows


def rough_of(scan: Scan, picks: Views, rows: Rows) -> Scan:
    """Some rows of coarse pixels of some of the views."""
    return binned_scan(scan, COARSENING, picks, rows)


def rough_piece(layout: Layout, parts: list[Scan], order: Views, piece: Piece) -> Image:
    """A piece of a coarse start (see `coarse_start`), from all views of it in some other order."""
    with use_worker_threads():
        return coarse_start(joined(parts).select(order), layout, piece)


def joined(scans: list[Scan]) -> Scan:
    """The views of all of them."""
    first = scans[0].geometry
    geometry = Geometry(np.concatenate([s.geometry.vectors for s in scans]), first.shape, first.beam)
    images, valid = np.concatenate([s.line_integrals for s in scans]), None
    if any(s.valid is not None for s in scans):
        valid = np.concatenate([np.ones(s.line_integrals.shape, bool) if s.valid is None else s.valid for s in scans])
    return Scan(images, geometry, valid)


# ---------------------------------------------------------------------- slabs
@dataclass(frozen=True, eq=False)
class SlabState:
    """A slab during the reconstruction, and the two sums of squares of each row before its last update."""

    slab: Slab
    squares: Float | None = None


def new_slab(layout: Layout, number: int) -> SlabState:
    """A slab of zeros."""
    return SlabState(slabs.new_slab(layout, number, _zeros(layout, number)))


def slab_from(layout: Layout, rough: Image, number: int, piece: Piece) -> SlabState:
    """A slab of a coarse start."""
    with use_worker_threads():
        planes = finer_slab(rough, layout, piece, number)
        return SlabState(slabs.slab_from(layout, number, _zeros(layout, number), planes))


def _zeros(layout: Layout, number: int) -> Image:
    first, end = layout.slabs[number]
    return np.zeros((end - first, *layout.shape[1:]), np.float32)


def forward(state: SlabState, views: Views) -> Strip:
    """Its line integrals in some views."""
    with use_worker_threads():
        return slabs.forward(state.slab, views)


def advance(
    layout: Layout, state: SlabState, parts: list[Strip], groups: list[RadiographRows], update: Update
) -> SlabState:
    """The slab after an update; the one given is not changed, for its line integrals may be needed again."""
    slab, before = state.slab, state.slab.before
    if update.momentum:
        before = pooled_copy(slab.image if before is None else before)
    slab = replace(slab, image=pooled_copy(slab.image), before=before)
    with use_worker_threads():
        corrections = slabs.compare(layout, update.views, parts, picked(groups, update.picks), update.step)
        slabs.advance(slab, corrections, update.views, update.momentum)
    return SlabState(slab, corrections.squares)


def picked(groups: list[RadiographRows], picks: list[Views]) -> RadiographRows:
    """``picks`` of each of the groups, in their order."""
    images = np.concatenate([group.images[pick] for group, pick in zip(groups, picks, strict=True)])
    valid = None
    if any(group.valid is not None for group in groups):
        valid = np.concatenate(
            [
                np.ones((len(pick), *group.images.shape[1:]), bool) if group.valid is None else group.valid[pick]
                for group, pick in zip(groups, picks, strict=True)
            ]
        )
    return RadiographRows(groups[0].first, images, valid)


def squares_of(state: SlabState) -> Float:
    """The two sums of squares of each row before the last update."""
    assert state.squares is not None
    return state.squares


# ---------------------------------------------------------------------- files
_STORED: WeakValueDictionary[Path, SlabState] = WeakValueDictionary()  # stored by this process and still in its memory


def store(state: SlabState, path: Path) -> None:
    """Write a slab to a file."""
    _STORED[path] = state
    with path.open("wb") as file:
        for image in (state.slab.image, state.slab.before):
            if image is not None:
                np.save(file, image)


def restored(layout: Layout, number: int, path: Path, momentum: float) -> SlabState:
    """A slab that was stored, with or without momentum; read from the file unless it is in memory."""
    state = _STORED.get(path)
    if state is not None and (state.slab.before is not None) == bool(momentum):
        return replace(state, squares=None)
    imaging = slabs.imaging_of(layout, number, _zeros(layout, number))
    with path.open("rb") as file:
        image, before = np.load(file), np.load(file) if momentum else None
    return SlabState(Slab(imaging, layout.footprints[number][0], image, before))


def store_planes(state: SlabState, path: Path) -> None:
    """Write the planes ``[z, y, x]`` as they were last constrained."""
    np.save(path, np.ascontiguousarray(state.slab.planes))
