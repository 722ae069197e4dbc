"""DistributedIterate: a reconstruction whose slabs are held and updated by workers (see `reconstruction.slabs`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Float, Progress
from grainmotion.cluster import reconstruction_tasks
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.shared_store import SharedStore, StoredObject
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.large_arrays import large_empty
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import sufficient_views
from grainmotion.reconstruction.coarse_start import COARSENING, has_coarse_start, pieces_of
from grainmotion.reconstruction.grid_growth import fitted_grid, growth_views
from grainmotion.reconstruction.hardening import consistent_hardening
from grainmotion.reconstruction.ordered_subsets import accelerated, plain_sart
from grainmotion.reconstruction.reconstruct import Reconstruction
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.slabs import Layout, Rows, total
from grainmotion.reconstruction.system import Views, column_sums, golden_order

if TYPE_CHECKING:
    from dask.delayed import Delayed


VIEWS_READ_TOGETHER = 16
"""Views that a worker reads at once."""
VIEWS_BETWEEN_CHECKPOINTS = 160
"""Views after which the slabs are stored, or half of the scan's if that is more: what a lost worker held is computed
again from there."""


@dataclass(eq=False)
class PendingSum:
    """Two sums of squares that workers still compute, each over the rows of its slab."""

    executor: Executor
    tasks: list[Delayed]
    rows: tuple[Rows, ...]
    known: Float | None = None
    __array_ufunc__ = None  # numpy leaves `array + PendingSum` to __radd__, which waits

    def __radd__(self, other: Float) -> Float:
        if self.known is None:
            self.resolve(self.executor.results(self.tasks))
        assert self.known is not None
        return other + self.known

    def resolve(self, squares: list[Float]) -> None:
        """Take the results of the tasks."""
        self.known = total(squares, self.rows)


class DistributedIterate:
    """A volume (`reconstruction.system.Iterate`) on workers, which read the radiographs themselves."""

    ahead = 2

    def __init__(
        self, executor: Executor, store: SharedStore, source: ScanInput, grid: Volume, settings: ReconstructSettings
    ) -> None:
        self.executor, self.store = executor, store
        settings = replace(settings, device="cpu")  # slabs have the layout of the CPU
        self.layout = Layout.of(grid, source.geometry, settings)
        self.sums = column_sums(source.geometry, grid)
        count, task = len(source.geometry), executor.task
        self._source, self._layout = executor.persist(
            [task(_take, stored=store.put(source)), task(_take, stored=store.put(self.layout))]
        )
        self._addresses = executor.addresses(len(self.layout.slabs))
        order = golden_order(count)
        self._place = np.argsort(order)  # of each view in that order, in which views are read
        groups = [order[k : k + VIEWS_READ_TOGETHER] for k in range(0, count, VIEWS_READ_TOGETHER)]
        readers = executor.addresses(len(groups))  # they send only the rows that are needed
        scans = [
            executor.task_at(reader, reconstruction_tasks.load_views, self._source, views=group)
            for reader, group in zip(readers, groups, strict=True)
        ]
        self._radiographs = [
            [
                executor.task_at(
                    address,
                    reconstruction_tasks.handed,
                    executor.task_at(reader, reconstruction_tasks.rows_of, scan, rows=rows),
                )
                for reader, scan in zip(readers, scans, strict=True)
            ]
            for address, rows in zip(self._addresses, self.layout.compared, strict=True)
        ]
        if settings.plain(count) or not has_coarse_start(grid.shape, source.geometry.shape):
            started = [
                executor.task_at(s, reconstruction_tasks.new_slab, self._layout, number=k)
                for k, s in enumerate(self._addresses)
            ]
        else:
            started = self._coarse_start(groups, list(zip(readers, scans, strict=True)))
        number = len(started)
        # all at once, so that no radiographs are read before there is memory for their rows
        found = executor.persist([*started, *(rows for images in self._radiographs for rows in images)])
        self._slabs = found[:number]
        self._radiographs = [found[number + k * len(scans) :][: len(scans)] for k in range(number)]
        self._views_since_checkpoint = self._updates = 0
        self._pending: list[PendingSum] = []

    def _coarse_start(self, groups: list[Views], scans: list[tuple[str, Delayed]]) -> list[Delayed]:
        """Slabs of a coarse start, each from some of the views, on the worker that will hold it."""
        task_at, found = self.executor.task_at, []
        wanted = sufficient_views(len(self._place), self.layout.geometry.shape[1] // COARSENING)
        picks = [np.flatnonzero(np.isin(group, wanted)) for group in groups]
        order = np.argsort(np.concatenate([group[pick] for group, pick in zip(groups, picks, strict=True)]))
        for piece in pieces_of(self.layout):
            address = self._addresses[piece.slabs[0]]
            parts = [
                task_at(reader, reconstruction_tasks.rough_of, scan, picks=pick, rows=piece.rows)
                for (reader, scan), pick in zip(scans, picks, strict=True)
                if len(pick)
            ]
            rough = task_at(address, reconstruction_tasks.rough_piece, self._layout, parts, order=order, piece=piece)
            found += [
                task_at(self._addresses[k], reconstruction_tasks.slab_from, self._layout, rough, number=k, piece=piece)
                for k in piece.slabs
            ]
        return found

    def update(self, views: Views, relaxation: float, momentum: float = 0.0) -> PendingSum:
        """See `Iterate`."""
        if self._views_since_checkpoint >= max(VIEWS_BETWEEN_CHECKPOINTS, len(self._place) // 2):
            self._views_since_checkpoint = 0
            self._store(momentum)
        task = self.executor.task_at  # without an address Dask would move slabs to idle workers
        places = self._place[views]
        groups = places // VIEWS_READ_TOGETHER
        cuts = np.flatnonzero(np.diff(groups)) + 1  # a subset follows that order, so a group comes in one piece
        picks, used = np.split(places % VIEWS_READ_TOGETHER, cuts), groups[np.r_[0, cuts]]
        asked = reconstruction_tasks.Update(views, picks, float(relaxation / self.sums[views].sum()), momentum)
        strips = [
            task(address, reconstruction_tasks.forward, s, views=views)
            for address, s in zip(self._addresses, self._slabs, strict=True)
        ]
        advanced = []
        held = zip(self._addresses, self._slabs, self._radiographs, strict=True)
        for k, (address, slab, rows) in enumerate(held):
            parts, scans = [strips[j] for j in self.layout.overlapping(k)], [rows[g] for g in used]
            advanced.append(task(address, reconstruction_tasks.advance, self._layout, slab, parts, scans, update=asked))
        squares = [
            task(address, reconstruction_tasks.squares_of, s)
            for address, s in zip(self._addresses, advanced, strict=True)
        ]
        found = self.executor.persist([*advanced, *squares])
        self._slabs = found[: len(advanced)]
        pending = PendingSum(self.executor, found[len(advanced) :], self.layout.compared)
        self._pending = [*(o for o in self._pending if o.known is None), pending]
        self._updates += 1
        self._views_since_checkpoint += len(views)
        return pending

    def volume(self) -> Volume:
        """See `Iterate`; it comes by files of the store."""
        paths = [self.store.folder / f"planes-{k}.npy" for k in range(len(self._slabs))]
        self.executor.results(
            [self.executor.task(reconstruction_tasks.store_planes, s, path=p) for s, p in zip(self._slabs, paths)]
        )
        array = large_empty(self.layout.shape, np.float32)
        for path, planes in zip(paths, self.layout.slabs, strict=True):
            array[slice(*planes)] = np.load(path, mmap_mode="r")
            path.unlink()
        return Volume(array, self.layout.voxel_size, self.layout.center)

    def into_volume(self) -> Volume:
        """See `Iterate`; the workers' arrays are no burden on this process."""
        return self.volume()

    def _store(self, momentum: float) -> None:
        """Continue from files, so that no earlier task is ever run again."""
        folder = self.store.folder
        paths = [folder / f"slab-{k}-{self._updates}.npy" for k in range(len(self._slabs))]
        stored = [
            self.executor.task(reconstruction_tasks.store, s, path=p) for s, p in zip(self._slabs, paths, strict=True)
        ]
        tasks = [task for pending in self._pending for task in pending.tasks]
        squares = self.executor.results([*stored, *tasks])[len(stored) :]
        for k, pending in enumerate(self._pending):
            pending.resolve(squares[k * len(stored) : (k + 1) * len(stored)])
        self._pending = []
        self._addresses = self.executor.addresses(len(paths))
        self._slabs = self.executor.persist(
            [
                self.executor.task_at(
                    address, reconstruction_tasks.restored, self._layout, number=k, path=path, momentum=momentum
                )
                for k, (address, path) in enumerate(zip(self._addresses, paths, strict=True))
            ]
        )
        for path in set(folder.glob("slab-*.npy")) - set(paths):  # no longer needed
            path.unlink()


def reconstruct_distributed(
    executor: Executor,
    store: SharedStore,
    source: ScanInput,
    grid: Volume,
    settings: ReconstructSettings,
    progress: Progress | None,
) -> Reconstruction:
    """`reconstruct`, from files that the workers read."""
    count = len(source.geometry)
    read = partial(reconstruction_tasks.load_views, source)
    fitted = fitted_grid(read(growth_views(count)), source.geometry, grid, settings)
    fitted.report(progress)
    settings = fitted.settings
    hardening = consistent_hardening(read, source.geometry, fitted.grid, settings)
    if not hardening.is_linear:  # a source that was calibrated with a curve of its own comes with the setting off
        source = replace(source, hardening=hardening)
    iterate = DistributedIterate(executor, store, source, fitted.grid, settings)
    if settings.plain(count):
        history = plain_sart(iterate, count, settings, progress)
    else:
        history = accelerated(iterate, count, progress)
    volume = replace(fitted.seen(iterate.volume()), hardening=hardening)
    return Reconstruction(volume, tuple(history), fitted.notes)


def _take(stored: StoredObject) -> object:
    return stored.load()
