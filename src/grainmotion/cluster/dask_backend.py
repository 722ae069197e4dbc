"""Crew: the workers of a cluster as a device, with the grains' voxels, line integrals and derivatives among them.

As with a GPU, what they hold says by itself that they trace it, and `DaskBackend.kernels` gives kernels of the same
names and arguments as the processor's.  Each is a graph of pure functions (`tracking_tasks`) over what is held, so what
is lost with a worker is made again by others.  How grains are divided among workers does not change the result: a
patch is worked on whole, by one worker, and sums over patches are taken in double precision, which is exact for single
numbers.  So there are as many pieces as workers, for a task costs some milliseconds whatever it does.  The client
sends poses and radiographs, and gets radiographs, gradients and 6×6 blocks.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.device import Device
from grainmotion.cluster import tracking_tasks
from grainmotion.cluster.executor import Executor
from grainmotion.cluster.remote_arrays import RemoteArray, RemoteSum, Split, Voxels, ends_of
from grainmotion.cluster.shared_store import SharedStore, StoredImages
from grainmotion.cluster.tracking_tasks import PatchTable, Rays
from grainmotion.kernels import normal_equations
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays

if TYPE_CHECKING:
    from dask.delayed import Delayed


WORTH = 5e7
"""Voxels of the reference's size from which grains are handed out, some to each worker: fewer are tracked by one
process, in one thread, sooner than by two workers (measured, decision 0013)."""
LARGEST = 1 << 27
"""Voxels of a piece: a worker holds two pieces, or more, one at a time."""
AT_ONCE = 4
"""Parts of the radiographs that one task adds up."""


def worth_sharing(voxels: float) -> bool:
    """Whether grains of so many voxels of the reference's size are handed out, some to each worker."""
    return voxels >= WORTH


@dataclass(frozen=True, eq=False)
class DaskBackend(Device):
    """Workers that walk grains."""

    work: Executor
    shelf: SharedStore
    walks_coarse = True

    @classmethod
    def of(cls, work: Executor, shelf: SharedStore) -> DaskBackend:
        """The workers that ``work`` reaches and who see the shelf."""
        return cls("workers", work, shelf)

    def hold(self, array: Any) -> Any:
        """The array: only voxels are shared out, and what comes of them."""
        return array

    def hold_voxels(self, images: Any, starts: Any, heights: Any, size: float) -> Any:
        """See `Device`; what is not worth it stays here.

        The same voxels are handed out once for all states, while as many workers are there.
        """
        if not worth_sharing(len(images) * min(size, 1.0) ** 3):
            return images
        base = images if images.base is None else images.base
        key = images.ctypes.data, starts.tobytes(), self.work.hands
        if key not in self.shelf.lasting:
            self.shelf.lasting[key] = self._shared_out(images, starts, heights)
            weakref.finalize(base, self.shelf.lasting.pop, key, None)
        return self.shelf.lasting[key]

    def _shared_out(self, images: Image, starts: Index, heights: Float) -> Voxels:
        """Pieces of neighbours along z, which shade few rows of the radiographs; workers load them from the shelf."""
        begins, rows = np.unique(starts, return_index=True)
        ends = np.append(begins[1:], len(images))
        order = np.argsort(heights[rows], kind="stable")
        count = min(len(begins), max(self.work.hands, -(-len(images) // LARGEST)))
        sizes = (ends - begins)[order]
        share = (np.cumsum(sizes) - sizes / 2) / len(images)
        members = np.split(order, np.searchsorted(share, np.arange(1, count) / count))
        owner, local = np.zeros(len(begins), np.int64), np.zeros(len(begins), np.int64)
        kept: list[StoredImages] = []
        for mine in filter(len, members):
            owner[mine], local[mine] = len(kept), ends_of((ends - begins)[mine])[:-1]
            kept.append(self.shelf.kept_images(np.concatenate([images[begins[k] : ends[k]] for k in mine])))
        spots = self.work.spots(len(kept))
        held = [self.work.task_at(spot, _take, shelved=k) for spot, k in zip(spots, kept, strict=True)]
        return Voxels(self, images.dtype, begins, owner, local, self.work.persist(held), spots, kept)

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array that a kernel is to fill."""
        return RemoteArray(self, shape, dtype)

    def kernels(self, name: str) -> Any:
        """See `Device`."""
        rooms: dict[str, tuple[Any, ...]] = {"grain_projection": (project, project_with_derivatives, add_patches)}
        rooms["normal_equations"] = (normal_equations.filter_images, filter_patches, blocks)
        return SimpleNamespace(**{kernel.__name__: kernel for kernel in rooms[name]})

    def gradients(self, derivatives: RemoteArray, boxes: Any, offsets: Any, stacks: Any, out: Float) -> None:
        """See `Device`."""
        assert derivatives.split is not None
        if isinstance(stacks, RemoteSum):
            found = self.work.results(
                [
                    self.work.task_at(spot, tracking_tasks.gradients, piece, *stacks.meeting(some.rows), some=some)
                    for spot, piece, some in derivatives.sides
                ]
            )
        else:
            with self.shelf.lent((np.stack(stacks),)) as lent:
                asked = derivatives.each(tracking_tasks.gradients, images=lent * len(derivatives.pieces))
                found = self.work.results(asked)
        for patches, part in zip(derivatives.split.patches, found, strict=True):
            out[:, patches] = part

    def spread(
        self, derivatives: RemoteArray, boxes: Any, offsets: Any, order: Any, first: Any, increments: Float, panels: Any
    ) -> RemoteSum:
        """See `Device`; the sums stay with the workers."""
        assert derivatives.split is not None
        own = [increments[:, rows] for rows in derivatives.split.grains]
        like = [(panels[0], panels[2])] * len(own)
        stripes = derivatives.each(tracking_tasks.spread, increments=own, like=like)
        rows = [some.rows for some in derivatives.split.some]
        return RemoteSum(self, stripes, rows, (len(increments), *panels), derivatives.dtype)

    def for_grains(
        self, function: Callable[..., Any], grains: GrainArrays, pose: Pose, images: tuple[Image, ...], how: Any
    ) -> Any:
        """See `Device`: a task for each piece."""
        voxels: Voxels = grains.walked
        owner, begins = voxels.places(grains.starts)
        rows = [np.flatnonzero(owner == k) for k in range(len(voxels.pieces))]
        asked = [k for k, own in enumerate(rows) if len(own)]
        with self.shelf.lent((np.stack(images),)) as (lent,):
            told, tasks = [], []
            for k in asked:
                own = grains.select(rows[k])
                without = replace(own, images=own.images[:0], starts=begins[rows[k]], held=None)
                here = pose.moved(pose.translations[rows[k]], pose.matrices[rows[k]])
                told.append(self.shelf.put((without, here, how)))
                literals = {"function": function, "told": told[-1], "images": lent}
                tasks.append(
                    self.work.task_at(voxels.spots[k], tracking_tasks.for_grains, voxels.pieces[k], **literals)
                )
            found = self.work.results(tasks)
        out = np.zeros((len(grains), *found[0].shape[1:]), found[0].dtype)
        for k, part in zip(asked, found, strict=True):
            out[rows[k]] = part
        return out

    def added_up(self, stripes: list[Delayed]) -> list[Delayed]:
        """A few parts of the sum of radiographs, neighbours added first."""
        while len(stripes) > AT_ONCE:
            groups = [stripes[k : k + AT_ONCE] for k in range(0, len(stripes), AT_ONCE)]
            stripes = [self.work.task(tracking_tasks.merge, *group) if len(group) > 1 else group[0] for group in groups]
        return stripes


# ---------------------------------------------------------------------- kernels.grains
def project(
    voxels: Voxels, starts: Index, shapes: Index, corners: Float, extents: Image, voxel: float, positions: Float,
    matrices: Float, vectors: Float, cone: bool, panel: Index, boxes: Index, offsets: Index, jobs: Index, exact: bool,
    values: RemoteArray, derivatives: RemoteArray | None = None,
) -> None:  # fmt: skip
    """As `kernels.grain_projection.project`, and with derivatives."""
    crew = voxels.walked_by
    owner, local = voxels.places(starts)
    split = Split.of(owner, voxels.spots, boxes, offsets)
    patch_owner, patch_row = split.owners
    found = []
    for k, (own, some, piece) in enumerate(zip(split.grains, split.some, voxels.pieces, strict=True)):
        mine = jobs[patch_owner[jobs[:, 0]] == k]
        mine[:, 0] = patch_row[mine[:, 0]]
        grains = (local[own], shapes[own], corners[own], extents[own], voxel, positions[own], matrices[own])
        rays = Rays(grains, (vectors, cone, panel), mine, exact)
        walk = tracking_tasks.project if derivatives is None else tracking_tasks.differentiate
        found.append(crew.work.task_at(split.spots[k], walk, piece, rays=rays, some=some))
    found = crew.work.persist(found)
    values.fill(found, split, offsets, (voxels,))
    if derivatives is not None:
        derivatives.fill(found, split, offsets, (voxels,))


def project_with_derivatives(*arguments: Any) -> None:
    """As `kernels.grain_projection.project_with_derivatives`."""
    project(*arguments)


def add_patches(values: RemoteArray, boxes: Index, offsets: Index, out: Image) -> None:
    """As `kernels.grain_projection.add_patches`."""
    crew, like = values.walked_by, (out.shape[0], out.shape[2])
    stripes = values.each(tracking_tasks.add_up, like=[like] * len(values.pieces))
    for stripe in crew.work.results(crew.added_up(stripes)):
        stripe.add_to(out[None])


# ---------------------------------------------------------------------- kernels.normal
def filter_patches(derivatives: RemoteArray, boxes: Index, offsets: Index, valid: Image, weights: Image) -> None:
    """As `kernels.normal_equations.filter_patches`."""
    crew, count = derivatives.walked_by, len(derivatives.pieces)
    factor = crew.shelf.kept_images(valid[None])
    found = crew.work.persist(
        derivatives.each(tracking_tasks.filtered, factor=[factor] * count, kernel=[weights] * count)
    )
    derivatives.fill(found, derivatives.split, derivatives.offsets, (*derivatives.kept, factor))


def blocks(derivatives: RemoteArray, boxes: Index, offsets: Index, pairs: Index, first: Index, out: Float) -> None:
    """As `kernels.normal_equations.blocks`: a piece borrows the derivatives of others' patches that meet its own."""
    crew, split = derivatives.walked_by, derivatives.split
    assert split is not None
    (owner, row), sizes = split.owners, np.diff(offsets)
    filled = np.flatnonzero(np.diff(first))
    left, right = owner[pairs[first[filled]]].T
    doer = np.where((left + right) % 2 == 0, left, right)
    tasks, asked = [], []
    for k, piece in enumerate(derivatives.pieces):
        mine = filled[doer == k]
        if not len(mine):
            continue
        counts = first[mine + 1] - first[mine]
        wanted = pairs[np.repeat(first[mine] - ends_of(counts)[:-1], counts) + np.arange(counts.sum())]
        foreign = np.unique(wanted[owner[wanted] != k])
        foreign = foreign[np.argsort(owner[foreign], kind="stable")]
        loans = [
            derivatives.at(m, tracking_tasks.lend, patches=row[foreign[owner[foreign] == m]])
            for m in np.unique(owner[foreign])
        ]
        present = np.concatenate([split.patches[k], foreign])
        place = np.zeros(len(boxes), np.int64)
        place[present] = np.arange(len(present))
        some = PatchTable(boxes[present], ends_of(sizes[present]))
        tasks.append(
            crew.work.task_at(
                split.spots[k],
                tracking_tasks.blocks,
                piece,
                *loans,
                some=some,
                pairs=place[wanted],
                first=ends_of(counts),
            )
        )
        asked.append(mine)
    out[:] = 0
    for mine, found in zip(asked, crew.work.results(tasks), strict=True):
        out[mine] = found


def _take(shelved: StoredImages) -> Image:
    return shelved.all()
