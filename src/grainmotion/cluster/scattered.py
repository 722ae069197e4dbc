"""Scattered: a volume under way, held by the workers in slabs; see `slabs` for what each of them does."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster import slabs
from grainmotion.cluster.shelf import Shelf, Shelved
from grainmotion.cluster.slabs import Layout
from grainmotion.cluster.work import Work
from grainmotion.experiment.scans import ScanInput
from grainmotion.reconstruct import Progress, Reconstruction
from grainmotion.reconstructing.accelerated import accelerated, has_coarse_start
from grainmotion.reconstructing.equations import Frame, Views, column_sums, golden_order
from grainmotion.reconstructing.sart import plain_sart
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.volume import Volume

if TYPE_CHECKING:
    from dask.delayed import Delayed

Float = NDArray[np.float64]

TOGETHER = 8
"""Views that are read, and held, together."""
STORED = 8
"""Updates after which the slabs are put on the shelf: what a dead worker held is made again from there."""


class Scattered:
    """An image under way (`reconstructing.equations.Iterate`), with workers that read the radiographs themselves."""

    def __init__(
        self, work: Work, shelf: Shelf, source: ScanInput, grid: Volume, settings: ReconstructSettings
    ) -> None:
        self.work, self.shelf, self.grid = work, shelf, grid
        settings = replace(settings, device="cpu")  # slabs are laid for processors
        self.layout = Layout(grid.shape, grid.voxel_size, grid.center, source.geometry, settings)
        self.frame, self.sums = Frame.of(grid, settings), column_sums(source.geometry, grid)
        count, task = len(source.geometry), work.task
        self._source, self._where = work.persist(
            [task(_take, shelved=shelf.put(source)), task(_take, shelved=shelf.put(self.layout))]
        )
        order = golden_order(count)
        self._place = np.argsort(order)  # of each view in that order, in which views are held together
        groups = [order[k : k + TOGETHER] for k in range(0, count, TOGETHER)]
        self._scans = work.persist([task(slabs.load_views, self._source, views=g) for g in groups])
        rough = None
        if not settings.plain(count) and has_coarse_start(grid.shape, source.geometry.shape):
            rough = task(slabs.coarse, self._source, self._where)
        self._slabs = work.placed(
            [
                task(slabs.new_slab, self._where, number=k)
                if rough is None
                else task(_from_rough, self._where, rough, number=k)
                for k in range(len(self.layout.slabs))
            ]
        )
        self._updates = 0

    def add_update(self, views: Views, relaxation: float) -> Float:
        """See `Iterate`."""
        task, places = self.work.task, self._place[views]
        groups = places // TOGETHER
        cuts = np.flatnonzero(np.diff(groups)) + 1  # a subset follows that order, so a group comes in one piece
        scans = [self._scans[g] for g in groups[np.r_[0, cuts]]]
        picks = np.split(places % TOGETHER, cuts)
        step = float(relaxation / self.sums[views].sum())
        strips = [task(slabs.forward, s, views=views) for s in self._slabs]
        corrections = task(slabs.compare, strips, scans, picks=picks, frame=self.frame, step=step)
        squares = task(slabs.squares_of, corrections)
        *self._slabs, squares = self.work.persist(
            [*(task(slabs.adjoint, s, corrections, views=views) for s in self._slabs), squares]
        )
        found: Float = self.work.results([squares])[0]
        return found

    def constrain(self) -> None:
        """See `Iterate`."""
        self._step([self.work.task(slabs.constrain, s) for s in self._slabs])

    def constrain_and_extrapolate(self, momentum: float) -> None:
        """See `Iterate`."""
        self._step([self.work.task(slabs.constrain_and_extrapolate, s, momentum=momentum) for s in self._slabs])

    def volume(self) -> Volume:
        """See `Iterate`; it comes by way of the shelf."""
        paths = [self.shelf.folder / f"planes-{k}.npy" for k in range(len(self._slabs))]
        self.work.results([self.work.task(slabs.store_planes, s, path=p) for s, p in zip(self._slabs, paths)])
        array = np.concatenate([np.load(path) for path in paths])
        for path in paths:
            path.unlink()
        return Volume(array, self.grid.voxel_size, self.grid.center)

    def _step(self, tasks: list[Delayed]) -> None:
        self._slabs = self.work.persist(tasks)
        self._updates += 1
        if self._updates % STORED == 0:
            paths = [self.shelf.folder / f"slab-{k}-{self._updates}.npy" for k in range(len(tasks))]
            self.work.results([self.work.task(slabs.store, s, path=p) for s, p in zip(self._slabs, paths)])
            self._slabs = self.work.placed(
                [self.work.task(slabs.restored, self._where, number=k, path=p) for k, p in enumerate(paths)]
            )
            for path in self.shelf.folder.glob(f"slab-*-{self._updates - 2 * STORED}.npy"):  # nobody asks for those
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


def _from_rough(layout: Layout, rough: Any, number: int) -> slabs.Slab:
    return slabs.new_slab(layout, number, rough)


def _take(shelved: Shelved) -> Any:
    return shelved.take()
