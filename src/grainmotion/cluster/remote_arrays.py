"""What workers hold of a state, as the client refers to it: voxels, arrays over patches, sums of radiographs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike, NDArray

from grainmotion._typing import Image, Index
from grainmotion.backends.image_sums import in_precision
from grainmotion.cluster import tracking_tasks
from grainmotion.cluster.executor import Executor
from grainmotion.kernels.layout import PatchTable, patch_table

if TYPE_CHECKING:
    from dask.delayed import Delayed

PARTS_ADDED_BY_A_TASK = 4
"""Parts of a sum of radiographs."""


@dataclass(frozen=True, eq=False)
class Voxels:
    """Voxels of grains in pieces, each held by the worker of an address.

    The voxels that begin at ``begins[k]`` of all lie in piece ``owner[k]``, from ``local[k]`` on; ``files`` are those
    from which workers load the pieces.
    """

    dtype: np.dtype[np.floating]
    begins: Index
    owner: Index
    local: Index
    pieces: list[Delayed]
    addresses: list[str]
    files: Sequence[object]

    def places(self, starts: Index) -> tuple[Index, Index]:
        """The piece of each grain, and where it begins there."""
        at = np.searchsorted(self.begins, starts)
        return self.owner[at], self.local[at]


@dataclass(frozen=True, eq=False)
class RemoteSum:
    """k stacks of radiographs, ``shape`` (k, views, rows, columns), held by workers in parts that add up to them.

    ``rows`` are the first row of each part and the one after its last.
    """

    executor: Executor
    parts: list[Delayed]
    rows: list[tuple[int, int]]
    shape: tuple[int, ...]
    dtype: np.dtype[np.floating]

    @cached_property
    def host(self) -> Image:
        """The sums in this process."""
        out = np.zeros(self.shape)
        for part in self.executor.results(added_up(self.executor, self.parts)):
            part.add_to(out)
        return in_precision(out, self.dtype)

    def meeting(self, rows: tuple[int, int]) -> list[Delayed]:
        """The parts that have some of these rows; one at least."""
        meet = [k for k, (first, end) in enumerate(self.rows) if first < rows[1] and end > rows[0]]
        return [self.parts[k] for k in meet or [0]]

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Image]:
        return iter(self.host)


def added_up(executor: Executor, strips: list[Delayed]) -> list[Delayed]:
    """A few parts of the sum of radiographs, neighbours added first."""
    size = PARTS_ADDED_BY_A_TASK
    while len(strips) > size:
        groups = [strips[k : k + size] for k in range(0, len(strips), size)]
        strips = [executor.task(tracking_tasks.merge, *group) if len(group) > 1 else group[0] for group in groups]
    return strips


@dataclass(frozen=True, eq=False)
class Split:
    """The patches of a sample, piece by piece.

    ``patches`` and ``grains`` are the rows in the sample of each piece's own, ``tables`` its patches, with grains
    counted within the piece, and ``addresses`` those of the workers that hold it.
    """

    patches: list[Index]
    grains: list[Index]
    tables: list[PatchTable]
    addresses: list[str]

    @classmethod
    def of(cls, owner: Index, addresses: list[str], patches: PatchTable) -> Split:
        """``owner (n,)`` is each grain's piece."""
        place, split = np.zeros(len(owner), np.int64), cls([], [], [], addresses)
        for k in range(len(addresses)):
            own, rows = np.flatnonzero(owner == k), np.flatnonzero(owner[patches.boxes[:, 0]] == k)
            place[own] = np.arange(len(own))
            boxes = patches.boxes[rows]
            boxes[:, 0] = place[boxes[:, 0]]
            split.patches.append(rows)
            split.grains.append(own)
            split.tables.append(patch_table(boxes, patches.lines[:0], len(patches.view_starts) - 1))
        return split

    @cached_property
    def owners(self) -> tuple[Index, Index]:
        """Piece of each patch, and its row there."""
        total = sum(map(len, self.patches))
        owner, row = np.zeros(total, np.int64), np.zeros(total, np.int64)
        for k, patches in enumerate(self.patches):
            owner[patches], row[patches] = k, np.arange(len(patches))
        return owner, row


@dataclass(eq=False)
class RemoteArray:
    """An array over all patches, ``(…, pixels)``, held by workers; indexing and numpy functions use a copy here.

    ``take`` gives the array from what a worker holds; ``offsets`` are those of the patches, and ``files`` those from
    which a lost piece would be made again.
    """

    executor: Executor
    shape: tuple[int, ...]
    dtype: np.dtype[np.floating]
    take: Callable[[Image | tracking_tasks.ProjectedPatches], Image]
    pieces: list[Delayed]
    split: Split
    offsets: Index
    files: tuple[object, ...]

    def fill(self, pieces: list[Delayed], *files: object) -> None:
        """Replace the pieces by what workers made of them, and of more files."""
        self.pieces, self.files = pieces, (*self.files, *files)
        self.__dict__.pop("host", None)

    @cached_property
    def host(self) -> Image:
        """The array in this process."""
        out = np.zeros(self.shape, self.dtype)
        tasks = [
            self.executor.task_at(address, self.take, piece)
            for address, piece in zip(self.split.addresses, self.pieces, strict=True)
        ]
        parts = self.executor.results(tasks)
        for patches, table, part in zip(self.split.patches, self.split.tables, parts, strict=True):
            sizes = np.diff(table.offsets)
            at = np.repeat(self.offsets[patches] - table.offsets[:-1], sizes) + np.arange(table.offsets[-1])
            out[..., at] = part
        return out

    def copy(self) -> RemoteArray:
        """An array that can be filled anew; the pieces are shared, for tasks never change them."""
        return replace(self)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Image:
        return self.host.astype(dtype or self.dtype, copy=bool(copy))

    def __getitem__(self, index: slice) -> Image:
        return self.host[index]

    def __len__(self) -> int:
        return self.shape[0]

    def each(self, function: Callable[..., object], *images: Delayed, **more: Sequence[object]) -> list[Delayed]:
        """A task for each piece, with its patches and its own item of each list in ``more``."""
        return [
            self.at(k, function, *images, **{name: items[k] for name, items in more.items()})
            for k in range(len(self.pieces))
        ]

    def at(self, k: int, function: Callable[..., object], *images: Delayed, **literals: object) -> Delayed:
        """A task for piece k and its patches, at the worker that holds it."""
        address, table = self.split.addresses[k], self.split.tables[k]
        return self.executor.task_at(address, function, self.pieces[k], *images, patches=table, **literals)


def ends_of(sizes: NDArray[np.integer]) -> Index:
    """Where pieces of such sizes begin one after the other, and the end of the last."""
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
