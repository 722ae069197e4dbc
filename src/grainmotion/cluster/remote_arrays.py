"""What workers hold of a state, as the client sees it: voxels, arrays over patches, sums of radiographs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from grainmotion._typing import Image, Index
from grainmotion.cluster import tracking_tasks
from grainmotion.cluster.shared_store import StoredImages
from grainmotion.cluster.tracking_tasks import PatchTable

if TYPE_CHECKING:
    from dask.delayed import Delayed

    from grainmotion.cluster.dask_backend import DaskBackend


@dataclass(frozen=True, eq=False)
class Voxels:
    """Voxels of grains; ``kept`` are the files from which workers have them, ``spots`` the addresses of these.

    What begins at ``begins[k]`` of all voxels lies in piece ``owner[k]``, from ``local[k]`` on.
    """

    walked_by: DaskBackend
    dtype: Any
    begins: Index
    owner: Index
    local: Index
    pieces: list[Delayed]
    spots: list[str]
    kept: list[StoredImages]

    def places(self, starts: Index) -> tuple[Index, Index]:
        """The piece of each grain, and where it begins there."""
        at = np.searchsorted(self.begins, starts)
        return self.owner[at], self.local[at]


@dataclass(frozen=True, eq=False)
class RemoteSum:
    """Stacks of radiographs ``(k, views, rows, columns)`` that workers hold, in parts that add up to them.

    ``rows`` are the first row of each part and the one after its last.
    """

    walked_by: DaskBackend
    parts: list[Delayed]
    rows: list[tuple[int, int]]
    shape: tuple[int, ...]
    dtype: Any

    @cached_property
    def host(self) -> Image:
        """The same numbers here."""
        out = np.zeros(self.shape)
        for part in self.walked_by.work.results(self.walked_by.added_up(self.parts)):
            part.add_to(out)
        return out.astype(self.dtype)

    def meeting(self, rows: tuple[int, int]) -> list[Delayed]:
        """The parts that have some of these rows; one at least."""
        meet = [k for k, (first, end) in enumerate(self.rows) if first < rows[1] and end > rows[0]]
        return [self.parts[k] for k in meet or [0]]

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> Image:
        found: Image = self.host[index]
        return found


@dataclass(frozen=True, eq=False)
class Split:
    """Patches of the sample, piece by piece: ``patches`` and ``grains`` of each in the sample, and its own ``some``.

    ``spots`` are the addresses of the workers that have them.
    """

    patches: list[Index]
    grains: list[Index]
    some: list[PatchTable]
    spots: list[str]

    @classmethod
    def of(cls, owner: Index, spots: list[str], boxes: Index, offsets: Index) -> Split:
        """``owner`` is each grain's piece."""
        sizes, place = np.diff(offsets), np.zeros(len(owner), np.int64)
        split = cls([], [], [], spots)
        for k in range(len(spots)):
            own, rows = np.flatnonzero(owner == k), np.flatnonzero(owner[boxes[:, 0]] == k)
            place[own] = np.arange(len(own))
            mine = boxes[rows]
            mine[:, 0] = place[mine[:, 0]]
            split.patches.append(rows)
            split.grains.append(own)
            split.some.append(PatchTable(mine, ends_of(sizes[rows])))
        return split

    @cached_property
    def owners(self) -> tuple[Index, Index]:
        """Piece of each patch, and its row there."""
        total = sum(map(len, self.patches))
        owner, row = np.zeros(total, np.int64), np.zeros(total, np.int64)
        for k, patches in enumerate(self.patches):
            owner[patches], row[patches] = k, np.arange(len(patches))
        return owner, row


class RemoteArray:
    """An array held by workers; indices and numpy's functions see its copy here, made when first asked for.

    It is flat over all patches, ``(…, pixels)`` in the order of ``offsets``; ``part`` takes it from what pieces are.
    """

    def __init__(self, crew: DaskBackend, shape: tuple[int, ...], dtype: Any) -> None:
        self.walked_by, self.shape, self.dtype = crew, shape, dtype
        self.split: Split | None = None
        self.part = tracking_tasks.values_of if len(shape) == 1 else tracking_tasks.derivatives_of
        self.offsets: Index = np.zeros(1, np.int64)
        self.pieces: list[Delayed] = []
        self.kept: tuple[Any, ...] = ()

    def fill(self, found: list[Delayed], split: Split | None, offsets: Index, kept: tuple[Any, ...]) -> None:
        """Take what workers made; ``kept`` owns the files from which it would be made again."""
        self.pieces, self.split, self.offsets, self.kept = found, split, offsets, kept
        self.__dict__.pop("host", None)

    @cached_property
    def host(self) -> Image:
        """The same numbers here."""
        out = np.zeros(self.shape, self.dtype)
        if self.split is None:
            return out
        work = self.walked_by.work
        found = work.results([work.task_at(spot, self.part, piece) for spot, piece, _ in self.sides])
        for patches, some, piece in zip(self.split.patches, self.split.some, found, strict=True):
            sizes = np.diff(some.offsets)
            at = np.repeat(self.offsets[patches] - some.offsets[:-1], sizes) + np.arange(some.offsets[-1])
            out[..., at] = piece
        return out

    def copy(self) -> RemoteArray:
        """Another array with the same numbers."""
        again = RemoteArray(self.walked_by, self.shape, self.dtype)
        again.fill(self.pieces, self.split, self.offsets, self.kept)
        return again

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Image:
        return self.host.astype(dtype or self.dtype, copy=bool(copy))

    def __getitem__(self, index: Any) -> Any:
        return self.host[index]

    def __len__(self) -> int:
        return self.shape[0]

    def each(self, function: Callable[..., Any], *images: Delayed, **more: list[Any]) -> list[Delayed]:
        """A task for each piece, with its patches and its own of what else there is a list of."""
        return [
            self.at(k, function, *images, **{name: each[k] for name, each in more.items()})
            for k in range(len(self.pieces))
        ]

    def at(self, k: int, function: Callable[..., Any], *images: Delayed, **literals: Any) -> Delayed:
        """A task for piece k, done where it is."""
        spot, piece, some = self.sides[k]
        return self.walked_by.work.task_at(spot, function, piece, *images, some=some, **literals)

    @property
    def sides(self) -> list[tuple[str, Delayed, PatchTable]]:
        """Of each piece who has it, the piece and its patches."""
        assert self.split is not None
        return list(zip(self.split.spots, self.pieces, self.split.some, strict=True))


def ends_of(sizes: Index) -> Index:
    """Where pieces of such sizes begin one after the other, and the end of the last."""
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
