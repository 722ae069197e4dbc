"""DaskBackend: the workers of a cluster as a backend that holds voxels, line integrals and derivatives.

Each operation is a graph of pure functions (`tracking_tasks`) of what workers hold, so what is lost with a worker is
computed again by others.  How grains are divided among workers does not change the result: a patch is computed by one
worker, and sums over patches are taken in double precision, which is exact for single numbers.  There are as many
pieces as workers, for a task costs some milliseconds whatever it does.  The client sends poses and radiographs, and
gets radiographs, gradients and 6×6 blocks.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.base import BackendArray, Grains, ImageStacks, PatchBackend, Settings
from grainmotion.backends.cpu import CPU
from grainmotion.backends.image_sums import in_precision
from grainmotion.cluster import tracking_tasks
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.remote_arrays import RemoteArray, RemoteSum, Split, Voxels, added_up, ends_of
from grainmotion.cluster.shared_store import SharedStore, StoredImages, StoredObject
from grainmotion.cluster.tracking_tasks import Rays
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.compact_volume import CompactVoxels
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays

if TYPE_CHECKING:
    from dask.delayed import Delayed


MIN_VOXELS_TO_SHARE = 5e7
"""Voxels of the reference's size from which grains are divided among workers: fewer are tracked by one process, in one
thread, sooner than by two workers (measured, decision 0013)."""
MAX_VOXELS_OF_PIECE = 1 << 27
"""Voxels of a piece: a worker holds two pieces, or more, one at a time."""


def worth_sharing(voxels: float) -> bool:
    """Whether grains of so many voxels of the reference's size are divided among workers."""
    return voxels >= MIN_VOXELS_TO_SHARE


@dataclass(frozen=True, eq=False)
class DaskBackend:
    """A `PatchBackend` of workers that share a folder; its arrays are `RemoteArray`."""

    executor: Executor
    store: SharedStore
    places_coarse_grains = True
    takes_compact_voxels = True

    def place_voxels(
        self, voxels: Image | CompactVoxels, starts: Index, heights: Float, relative_size: float
    ) -> tuple[PatchBackend, object]:
        """See `PatchBackend`; the CPU keeps what is not worth sharing.

        The same voxels are handed out once for all states, while the number of workers is the same.
        """
        compact = isinstance(voxels, CompactVoxels)
        total = int(voxels.sizes.sum()) if isinstance(voxels, CompactVoxels) else len(voxels)
        if not worth_sharing(total * min(relative_size, 1.0) ** 3):
            return CPU, voxels
        if isinstance(voxels, CompactVoxels):
            base: object = voxels.volumes[0]
            place = id(base)
        else:
            base, place = voxels if voxels.base is None else voxels.base, voxels.ctypes.data
        key = place, compact, starts.tobytes(), self.executor.worker_count
        if key not in self.store.shared:
            self.store.shared[key] = self._distributed(voxels, starts, heights)
            weakref.finalize(base, self.store.shared.pop, key, None)
        return self, self.store.shared[key]

    def _distributed(self, voxels: Image | CompactVoxels, starts: Index, heights: Float) -> Voxels:
        """Pieces of grains that are neighbours along z, so that they reach few rows; workers load them from files."""
        begins, rows = np.unique(starts, return_index=True)
        if isinstance(voxels, CompactVoxels):
            each = voxels.sizes[begins]
        else:
            each = np.diff(np.append(begins, len(voxels)))
        total, order = int(each.sum()), np.argsort(heights[rows], kind="stable")
        count = min(len(begins), max(self.executor.worker_count, -(-total // MAX_VOXELS_OF_PIECE)))
        sizes = each[order]
        share = (np.cumsum(sizes) - sizes / 2) / total
        members = np.split(order, np.searchsorted(share, np.arange(1, count) / count))
        owner, local = np.zeros(len(begins), np.int64), np.zeros(len(begins), np.int64)
        files: list[StoredImages | StoredObject[CompactVoxels]] = []
        for mine in filter(len, members):
            owner[mine], local[mine] = len(files), ends_of(each[mine])[:-1]
            if isinstance(voxels, CompactVoxels):
                files.append(self.store.put(voxels.end_to_end(begins[mine])))
            else:
                pieces = [voxels[begins[k] : begins[k] + each[k]] for k in mine]
                files.append(self.store.store_images(np.concatenate(pieces)))
        addresses = self.executor.addresses(len(files))
        loaded = [self.executor.task_at(a, _load, stored=file) for a, file in zip(addresses, files, strict=True)]
        return Voxels(voxels.dtype, begins, owner, local, self.executor.persist(loaded), addresses, files)

    def place_patches(self, patches: PatchTable) -> PatchTable:
        return patches

    def project(self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool) -> RemoteArray:
        pieces, split, voxels = self._projected(tracking_tasks.project, grains, views, patches, exact)
        return self._array((), tracking_tasks.values_of, pieces, split, patches, voxels)

    def project_with_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[RemoteArray, RemoteArray]:
        made = self._projected(tracking_tasks.differentiate, grains, views, patches, exact)
        pieces, split, voxels = made
        return (
            self._array((), tracking_tasks.values_of, pieces, split, patches, voxels),
            self._array((6,), tracking_tasks.derivatives_of, pieces, split, patches, voxels),
        )

    def _projected(
        self, task: Callable[..., object], grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[list[Delayed], Split, Voxels]:
        """What a task makes of each piece."""
        voxels = grains.voxels
        assert isinstance(voxels, Voxels)
        owner, local = voxels.places(grains.starts)
        split = Split.of(owner, voxels.addresses, patches)
        patch_owner, patch_row = split.owners
        tasks = []
        for k, (own, table, piece) in enumerate(zip(split.grains, split.tables, voxels.pieces, strict=True)):
            lines = patches.lines[patch_owner[patches.lines[:, 0]] == k]
            lines[:, 0] = patch_row[lines[:, 0]]
            mine = GrainTable(
                None, local[own], grains.shapes[own], grains.corners[own], grains.extents[own], grains.voxel_size,
                grains.positions[own], grains.rotations[own],
            )  # fmt: skip
            rays = Rays(mine, views, table._replace(lines=lines), exact)
            tasks.append(self.executor.task_at(split.addresses[k], task, piece, rays=rays))
        return self.executor.persist(tasks), split, voxels

    def add_patches(self, values: BackendArray, patches: PatchTable, shape: tuple[int, int, int]) -> Image:
        values, images = _remote(values), np.zeros(shape)
        strips = values.each(tracking_tasks.add_up, like=[(shape[0], shape[2])] * len(values.pieces))
        for strip in self.executor.results(added_up(self.executor, strips)):
            strip.add_to(images[None])
        return in_precision(images, values.dtype)

    def filter_images(self, images: Image, kernel: Image) -> None:
        CPU.filter_images(images, kernel)

    def filter_patches(self, derivatives: BackendArray, patches: PatchTable, factor: Image, kernel: Image) -> None:
        derivatives, stored = _remote(derivatives), self.store.store_images(factor[None])
        count = len(derivatives.pieces)
        tasks = derivatives.each(tracking_tasks.filtered, factor=[stored] * count, kernel=[kernel] * count)
        derivatives.fill(self.executor.persist(tasks), stored)

    def vjp(self, derivatives: BackendArray, patches: PatchTable, stacks: ImageStacks | Sequence[Image]) -> Float:
        derivatives = _remote(derivatives)
        if isinstance(stacks, RemoteSum):
            tasks = [
                derivatives.at(k, tracking_tasks.vjp, *stacks.meeting(tracking_tasks.rows_of(table)))
                for k, table in enumerate(derivatives.split.tables)
            ]
            parts = self.executor.results(tasks)
        else:
            with self.store.temporary((np.stack(list(stacks)),)) as stored:
                tasks = derivatives.each(tracking_tasks.vjp, images=stored * len(derivatives.pieces))
                parts = self.executor.results(tasks)
        out = np.zeros((len(stacks), len(patches.boxes), 6))
        for rows, part in zip(derivatives.split.patches, parts, strict=True):
            out[:, rows] = part
        return out

    def jvp(
        self, derivatives: BackendArray, patches: PatchTable, increments: Float, shape: tuple[int, int, int]
    ) -> RemoteSum:
        """See `PatchBackend`; the sums stay with the workers."""
        derivatives = _remote(derivatives)
        own = [increments[:, rows] for rows in derivatives.split.grains]
        strips = derivatives.each(tracking_tasks.jvp, increments=own, like=[(shape[0], shape[2])] * len(own))
        rows = [tracking_tasks.rows_of(table) for table in derivatives.split.tables]
        return RemoteSum(self.executor, strips, rows, (len(increments), *shape), derivatives.dtype)

    def gram_blocks(self, derivatives: BackendArray, patches: PatchTable, pairs: Index, first: Index) -> Float:
        """See `PatchBackend`; a worker gets the derivatives of others' patches that meet its own."""
        derivatives = _remote(derivatives)
        split, out = derivatives.split, np.zeros((len(first) - 1, 6, 6))
        (owner, row), sizes = split.owners, np.diff(patches.offsets)
        filled = np.flatnonzero(np.diff(first))
        left, right = owner[pairs[first[filled]]].T
        computed_by = np.where((left + right) % 2 == 0, left, right)
        tasks, asked = [], []
        for k in range(len(derivatives.pieces)):
            mine = filled[computed_by == k]
            if not len(mine):
                continue
            counts = first[mine + 1] - first[mine]
            wanted = pairs[np.repeat(first[mine] - ends_of(counts)[:-1], counts) + np.arange(counts.sum())]
            foreign = np.unique(wanted[owner[wanted] != k])
            foreign = foreign[np.argsort(owner[foreign], kind="stable")]
            others = [
                derivatives.at(m, tracking_tasks.select, which=row[foreign[owner[foreign] == m]])
                for m in np.unique(owner[foreign])
            ]
            present = np.concatenate([split.patches[k], foreign])
            place = np.zeros(len(patches.boxes), np.int64)
            place[present] = np.arange(len(present))
            table = PatchTable(
                patches.boxes[present], ends_of(sizes[present]), patches.lines[:0], patches.order[:0], patches.order[:0]
            )
            literals = {"patches": table, "pairs": place[wanted], "first": ends_of(counts)}
            piece = derivatives.pieces[k]
            tasks.append(
                self.executor.task_at(split.addresses[k], tracking_tasks.gram_blocks, piece, *others, **literals)
            )
            asked.append(mine)
        for mine, part in zip(asked, self.executor.results(tasks), strict=True):
            out[mine] = part
        return out

    def map_grains(
        self,
        function: Callable[[Grains, Pose, tuple[Image, ...], Settings], Float],
        grains: Grains,
        pose: Pose,
        images: tuple[Image, ...],
        settings: Settings,
    ) -> Float:
        """See `PatchBackend`: a task for each piece."""
        assert isinstance(grains, GrainArrays)
        voxels = grains.placed
        assert isinstance(voxels, Voxels)
        owner, begins = voxels.places(grains.starts)
        rows = [np.flatnonzero(owner == k) for k in range(len(voxels.pieces))]
        asked = [k for k, own in enumerate(rows) if len(own)]
        with self.store.temporary((np.stack(images),)) as (temporary,):
            stored, tasks = [], []
            for k in asked:
                own = grains.select(rows[k])
                without_voxels = replace(
                    own, images=own.images[:0], compact=None, starts=begins[rows[k]], backend=CPU, placed=None
                )
                here = pose.moved(pose.translations[rows[k]], pose.matrices[rows[k]])
                stored.append(self.store.put((without_voxels, here, settings)))
                literals = {"function": function, "stored": stored[-1], "images": temporary}
                task, address = tracking_tasks.map_grains, voxels.addresses[k]
                tasks.append(self.executor.task_at(address, task, voxels.pieces[k], **literals))
            parts = self.executor.results(tasks)
        out = np.zeros((len(grains), *parts[0].shape[1:]), parts[0].dtype)
        for k, part in zip(asked, parts, strict=True):
            out[rows[k]] = part
        return out

    def _array(
        self,
        axes: tuple[int, ...],
        take: Callable[[tracking_tasks.Piece], Image],
        pieces: list[Delayed],
        split: Split,
        patches: PatchTable,
        voxels: Voxels,
    ) -> RemoteArray:
        shape = (*axes, int(patches.offsets[-1]))
        return RemoteArray(self.executor, shape, voxels.dtype, take, pieces, split, patches.offsets, (voxels,))


def _remote(array: BackendArray) -> RemoteArray:
    assert isinstance(array, RemoteArray)
    return array


def _load(stored: StoredImages | StoredObject[CompactVoxels]) -> Image:
    if isinstance(stored, StoredImages):
        return stored.all()
    compact = stored.load()
    return compact.written(np.arange(len(compact.volumes)))[0]
