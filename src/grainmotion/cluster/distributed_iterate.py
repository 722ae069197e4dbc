"""Scattered: a volume under way, held by the workers in slabs; see `slabs` for what each of them does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from grainmotion._typing import Float, Progress
from grainmotion.cluster import reconstruction_tasks
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import sufficient_views
from grainmotion.reconstruction.coarse_start import COARSENING, has_coarse_start, pieces_of
from grainmotion.reconstruction.ordered_subsets import accelerated, plain_sart
from grainmotion.reconstruction.reconstruct import Reconstruction
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.slabs import Layout, Rows, total
from grainmotion.reconstruction.system import Views, column_sums, golden_order

if TYPE_CHECKING:
    from dask.delayed import Delayed


TOGETHER = 16
"""Views that are read, and held, together."""
STORED = 160
"""Views after which the slabs are put on the shelf: what a dead worker held is made again from there."""


@dataclass(eq=False)
class PendingSum:
    """Two sums of squares that the workers will have made, each of the rows that it compares."""

    work: Executor
    tasks: list[Delayed]
    rows: tuple[Rows, ...]
    known: Float | None = None
    __array_ufunc__ = None  # an array that these are added to waits for them

    def __radd__(self, other: Float) -> Float:
        if self.known is None:
            self.settle(self.work.results(self.tasks))
        assert self.known is not None
        return other + self.known

    def settle(self, found: list[Float]) -> None:
        """Take what the tasks have found."""
        self.known = total(found, self.rows)


class Scattered:
    """An image under way (`reconstruction.system.Iterate`), with workers that read the radiographs themselves."""

    ahead = 2

    def __init__(
        self, work: Executor, shelf: SharedStore, source: ScanInput, grid: Volume, settings: ReconstructSettings
    ) -> None:
        self.work, self.shelf = work, shelf
        settings = replace(settings, device="cpu")  # slabs are laid for processors
        self.layout = Layout.of(grid, source.geometry, settings)
        self.sums = column_sums(source.geometry, grid)
        count, task = len(source.geometry), work.task
        self._source, self._where = work.persist(
            [task(_take, shelved=shelf.put(source)), task(_take, shelved=shelf.put(self.layout))]
        )
        self._spots = work.spots(len(self.layout.slabs))
        order = golden_order(count)
        self._place = np.argsort(order)  # of each view in that order, in which views are held together
        groups = [order[k : k + TOGETHER] for k in range(0, count, TOGETHER)]
        readers = work.spots(len(groups))  # they hand on no more of what they read than is asked for
        scans = [
            work.task_at(reader, reconstruction_tasks.load_views, self._source, views=group)
            for reader, group in zip(readers, groups, strict=True)
        ]
        self._seen = [
            [
                work.task_at(
                    spot,
                    reconstruction_tasks.handed,
                    work.task_at(reader, reconstruction_tasks.rows_of, scan, rows=rows),
                )
                for reader, scan in zip(readers, scans, strict=True)
            ]
            for spot, rows in zip(self._spots, self.layout.compared, strict=True)
        ]
        if settings.plain(count) or not has_coarse_start(grid.shape, source.geometry.shape):
            started = [
                work.task_at(s, reconstruction_tasks.new_slab, self._where, number=k) for k, s in enumerate(self._spots)
            ]
        else:
            started = self._coarse_start(groups, list(zip(readers, scans, strict=True)))
        number = len(started)
        # all at once, so that no radiographs are read before there is room for what is made of them
        found = work.persist([*started, *(rows for seen in self._seen for rows in seen)])
        self._slabs = found[:number]
        self._seen = [found[number + k * len(scans) :][: len(scans)] for k in range(number)]
        self._walked = self._updates = 0
        self._owed: list[PendingSum] = []

    def _coarse_start(self, groups: list[Views], scans: list[tuple[str, Delayed]]) -> list[Delayed]:
        """Slabs of a coarse start, which whoever is to hold them makes of some of the views that others read."""
        task_at, found = self.work.task_at, []
        wanted = sufficient_views(len(self._place), self.layout.geometry.shape[1] // COARSENING)
        picks = [np.flatnonzero(np.isin(group, wanted)) for group in groups]
        order = np.argsort(np.concatenate([group[pick] for group, pick in zip(groups, picks, strict=True)]))
        for piece in pieces_of(self.layout):
            spot = self._spots[piece.slabs[0]]
            parts = [
                task_at(reader, reconstruction_tasks.rough_of, scan, picks=pick, rows=piece.rows)
                for (reader, scan), pick in zip(scans, picks, strict=True)
                if len(pick)
            ]
            rough = task_at(spot, reconstruction_tasks.rough_piece, self._where, parts, order=order, piece=piece)
            found += [
                task_at(self._spots[k], reconstruction_tasks.slab_from, self._where, rough, number=k, piece=piece)
                for k in piece.slabs
            ]
        return found

    def update(self, views: Views, relaxation: float, momentum: float = 0.0) -> PendingSum:
        """See `Iterate`."""
        if self._walked >= STORED:
            self._walked = 0
            self._store(momentum)
        task, places = self.work.task_at, self._place[views]  # else slabs are moved to whoever is idle
        groups = places // TOGETHER
        cuts = np.flatnonzero(np.diff(groups)) + 1  # a subset follows that order, so a group comes in one piece
        picks, held = np.split(places % TOGETHER, cuts), groups[np.r_[0, cuts]]
        asked = reconstruction_tasks.Update(views, picks, float(relaxation / self.sums[views].sum()), momentum)
        strips = [
            task(spot, reconstruction_tasks.forward, s, views=views)
            for spot, s in zip(self._spots, self._slabs, strict=True)
        ]
        advanced = []
        for k, (spot, slab, seen) in enumerate(zip(self._spots, self._slabs, self._seen, strict=True)):
            parts, scans = [strips[j] for j in self.layout.overlapping(k)], [seen[g] for g in held]
            advanced.append(task(spot, reconstruction_tasks.advance, self._where, slab, parts, scans, update=asked))
        squares = [
            task(spot, reconstruction_tasks.squares_of, s) for spot, s in zip(self._spots, advanced, strict=True)
        ]
        found = self.work.persist([*advanced, *squares])
        self._slabs = found[: len(advanced)]
        owed = PendingSum(self.work, found[len(advanced) :], self.layout.compared)
        self._owed = [*(o for o in self._owed if o.known is None), owed]
        self._updates += 1
        self._walked += len(views)
        return owed

    def volume(self) -> Volume:
        """See `Iterate`; it comes by way of the shelf."""
        paths = [self.shelf.folder / f"planes-{k}.npy" for k in range(len(self._slabs))]
        self.work.results(
            [self.work.task(reconstruction_tasks.store_planes, s, path=p) for s, p in zip(self._slabs, paths)]
        )
        array = np.empty(self.layout.shape, np.float32)
        for path, planes in zip(paths, self.layout.slabs, strict=True):
            array[slice(*planes)] = np.load(path, mmap_mode="r")
            path.unlink()
        return Volume(array, self.layout.voxel_size, self.layout.center)

    def _store(self, momentum: float) -> None:
        """Go on from files, so that no task before them will ever be asked for again."""
        task, folder = self.work.task, self.shelf.folder
        paths = [folder / f"slab-{k}-{self._updates}.npy" for k in range(len(self._slabs))]
        stored = [task(reconstruction_tasks.store, s, path=p) for s, p in zip(self._slabs, paths, strict=True)]
        found = self.work.results([*stored, *(t for owed in self._owed for t in owed.tasks)])[len(stored) :]
        for k, owed in enumerate(self._owed):
            owed.settle(found[k * len(stored) : (k + 1) * len(stored)])
        self._owed = []
        self._spots = self.work.spots(len(paths))
        self._slabs = self.work.persist(
            [
                self.work.task_at(
                    spot, reconstruction_tasks.restored, self._where, number=k, path=path, momentum=momentum
                )
                for k, (spot, path) in enumerate(zip(self._spots, paths, strict=True))
            ]
        )
        for path in set(folder.glob("slab-*.npy")) - set(paths):  # nobody asks for those
            path.unlink()


def reconstruct_scattered(
    work: Executor,
    shelf: SharedStore,
    source: ScanInput,
    grid: Volume,
    settings: ReconstructSettings,
    progress: Progress | None,
) -> Reconstruction:
    """`reconstruct`, from files that the workers read."""
    count = len(source.geometry)
    iterate = Scattered(work, shelf, source, grid, settings)
    if settings.plain(count):
        history = plain_sart(iterate, count, settings, progress)
    else:
        history = accelerated(iterate, count, progress)
    return Reconstruction(iterate.volume(), tuple(history))


def _take(shelved: StoredObject) -> Any:
    return shelved.take()
