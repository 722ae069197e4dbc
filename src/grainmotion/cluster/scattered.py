"""Scattered: a volume under way, held by the workers in slabs; see `slabs` for what each of them does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster import slabs
from grainmotion.cluster.shelf import Shelf, Shelved
from grainmotion.cluster.work import Work
from grainmotion.experiment.scans import ScanInput
from grainmotion.reconstruct import Progress, Reconstruction
from grainmotion.reconstructing.accelerated import accelerated, has_coarse_start
from grainmotion.reconstructing.equations import Views, column_sums, golden_order
from grainmotion.reconstructing.sart import plain_sart
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.reconstructing.slabs import Layout, Rows, total
from grainmotion.volume import Volume

if TYPE_CHECKING:
    from dask.delayed import Delayed

Float = NDArray[np.float64]

TOGETHER = 16
"""Views that are read, and held, together."""
STORED = 160
"""Views after which the slabs are put on the shelf: what a dead worker held is made again from there."""


@dataclass(eq=False)
class Owed:
    """Two sums of squares that the workers will have made, each of the rows that it compares."""

    work: Work
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
    """An image under way (`reconstructing.equations.Iterate`), with workers that read the radiographs themselves."""

    ahead = 2

    def __init__(
        self, work: Work, shelf: Shelf, source: ScanInput, grid: Volume, settings: ReconstructSettings
    ) -> None:
        self.work, self.shelf = work, shelf
        settings = replace(settings, device="cpu")  # slabs are laid for processors
        self.layout = Layout.of(grid, source.geometry, settings)
        self.sums = column_sums(source.geometry, grid)
        count, task = len(source.geometry), work.task
        self._source, self._where = work.persist(
            [task(_take, shelved=shelf.put(source)), task(_take, shelved=shelf.put(self.layout))]
        )
        numbers = range(len(self.layout.slabs))
        if settings.plain(count) or not has_coarse_start(grid.shape, source.geometry.shape):
            slabs_ = [task(slabs.new_slab, self._where, number=k) for k in numbers]
        else:
            rough = task(slabs.coarse, self._source, self._where)
            slabs_ = [task(slabs.slab_from, self._where, rough, number=k) for k in numbers]
        self._slabs = work.placed(slabs_)
        self._spots = work.spots(len(slabs_))
        order = golden_order(count)
        self._place = np.argsort(order)  # of each view in that order, in which views are held together
        self._seen = self._radiographs([order[k : k + TOGETHER] for k in range(0, count, TOGETHER)])
        self._walked = self._updates = 0
        self._owed: list[Owed] = []

    def _radiographs(self, groups: list[Views]) -> list[list[Delayed]]:
        """Of each slab the rows that it watches, with who holds it, group by group of views."""
        task = self.work.task
        scans = self.work.persist([task(slabs.load_views, self._source, views=g) for g in groups])
        return self.work.placed_together(
            [[task(slabs.rows_of, scan, rows=rows) for scan in scans] for rows in self.layout.watched]
        )

    def update(self, views: Views, relaxation: float, momentum: float = 0.0) -> Owed:
        """See `Iterate`."""
        task, places = self.work.task_at, self._place[views]  # else slabs are moved to whoever is idle
        groups = places // TOGETHER
        cuts = np.flatnonzero(np.diff(groups)) + 1  # a subset follows that order, so a group comes in one piece
        told = {"views": views, "picks": np.split(places % TOGETHER, cuts)}
        told["step"] = float(relaxation / self.sums[views].sum())
        strips = [task(spot, slabs.forward, s, views=views) for spot, s in zip(self._spots, self._slabs, strict=True)]
        corrections = []
        for k, (spot, seen) in enumerate(zip(self._spots, self._seen, strict=True)):
            parts, scans = [strips[j] for j in self.layout.beside(k)], [seen[g] for g in groups[np.r_[0, cuts]]]
            corrections.append(task(spot, slabs.compare, self._where, parts, scans, **told))
        advanced = [
            task(spot, slabs.advance, s, c, views=views, momentum=momentum)
            for spot, s, c in zip(self._spots, self._slabs, corrections, strict=True)
        ]
        squares = [task(spot, slabs.squares_of, c) for spot, c in zip(self._spots, corrections, strict=True)]
        found = self.work.persist([*advanced, *squares])
        self._slabs = found[: len(advanced)]
        owed = Owed(self.work, found[len(advanced) :], self.layout.watched)
        self._owed = [*(o for o in self._owed if o.known is None), owed]
        self._updates += 1
        self._walked += len(views)
        if self._walked >= STORED:
            self._walked = 0
            self._store(momentum)
        return owed

    def volume(self) -> Volume:
        """See `Iterate`; it comes by way of the shelf."""
        paths = [self.shelf.folder / f"planes-{k}.npy" for k in range(len(self._slabs))]
        self.work.results([self.work.task(slabs.store_planes, s, path=p) for s, p in zip(self._slabs, paths)])
        array = np.empty(self.layout.shape, np.float32)
        for path, planes in zip(paths, self.layout.slabs, strict=True):
            array[slice(*planes)] = np.load(path, mmap_mode="r")
            path.unlink()
        return Volume(array, self.layout.voxel_size, self.layout.center)

    def _store(self, momentum: float) -> None:
        """Go on from files, so that no task before them will ever be asked for again."""
        task, folder = self.work.task, self.shelf.folder
        paths = [folder / f"slab-{k}-{self._updates}.npy" for k in range(len(self._slabs))]
        stored = [task(slabs.store, s, path=p) for s, p in zip(self._slabs, paths, strict=True)]
        found = self.work.results([*stored, *(t for owed in self._owed for t in owed.tasks)])[len(stored) :]
        for k, owed in enumerate(self._owed):
            owed.settle(found[k * len(stored) : (k + 1) * len(stored)])
        self._owed = []
        self._slabs = self.work.placed(
            [task(slabs.restored, self._where, number=k, path=p, momentum=momentum) for k, p in enumerate(paths)]
        )
        self._spots = self.work.spots(len(paths))
        for path in set(folder.glob("slab-*.npy")) - set(paths):  # nobody asks for those
            path.unlink()


def reconstruct_scattered(
    work: Work, shelf: Shelf, source: ScanInput, grid: Volume, settings: ReconstructSettings, progress: Progress | None
) -> Reconstruction:
    """`reconstruct`, from files that the workers read."""
    count = len(source.geometry)
    iterate = Scattered(work, shelf, source, grid, settings)
    if settings.plain(count):
        history = plain_sart(iterate, count, settings, progress)
    else:
        history = accelerated(iterate, count, progress)
    return Reconstruction(iterate.volume(), tuple(history))


def _take(shelved: Shelved) -> Any:
    return shelved.take()
