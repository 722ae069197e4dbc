"""Team: a state worked out by many processes, block of grains by block; see `shares` for what each of them does.

Every evaluation is one graph of pure functions over what is held by the workers: blocks of grains and radiographs,
which they load from the shelf.  So whatever dies with a worker is made again by others, and one that joins gets
work.  The client sends poses, and gets costs, gradients and 6×6 blocks.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from grainmotion.cluster import shares
from grainmotion.cluster.blocks import Index, block_rows, cut, guessed_rows, posed
from grainmotion.cluster.shelf import Shelf, Shelved, ShelvedImages
from grainmotion.cluster.work import Work
from grainmotion.grains import GrainSet
from grainmotion.packed import Image, PackedGrains, Pose
from grainmotion.solve import Linearization
from grainmotion.tracking.cast import Shown
from grainmotion.tracking.columns import Columns
from grainmotion.tracking.coupling import block_matrix
from grainmotion.tracking.target import ALONE, Seen, Target

if TYPE_CHECKING:
    from dask.delayed import Delayed

Float = NDArray[np.float64]


AT_ONCE = 4
"""Parts of the radiographs that one task adds up."""
FEW = 16
"""Blocks up to which each is sent whole radiographs: one message less, and hardly more bytes."""


@dataclass(frozen=True, eq=False)
class Held:
    """Grains held by workers: rows of each block in the sample, and the blocks."""

    rows: list[Index]
    blocks: list[Delayed]


@dataclass(eq=False)
class Team:
    """Who walks the grains of a state (`tracking.target.Crew`): the workers of a Dask cluster."""

    work: Work
    shelf: Shelf

    def __post_init__(self) -> None:
        self._packed: weakref.WeakKeyDictionary[GrainSet, dict[bool, PackedGrains]] = weakref.WeakKeyDictionary()
        self._held: weakref.WeakKeyDictionary[PackedGrains, Held] = weakref.WeakKeyDictionary()
        self._targets: weakref.WeakKeyDictionary[Target, Delayed] = weakref.WeakKeyDictionary()

    # ------------------------------------------------------------------ what tracking asks for
    def pack(self, grains: GrainSet, fine: bool) -> PackedGrains:
        """See `Crew`; workers load the grains of a sample once."""
        known = self._packed.setdefault(grains, {})
        if fine not in known:
            known[fine] = PackedGrains.of(grains, fine)
        return known[fine]

    def look(self, grains: PackedGrains, target: Target, pose: Pose) -> Seen:
        """See `Crew`."""
        held, task = self._hold(grains), self.work.task
        casts, parts = self._parts(held, target, pose)
        compared = task(shares.compare, self._target(target), *parts, pose=_around(pose))
        parcel = task(shares.parcel, compared, *parts)
        compared, *own = self.work.persist([compared, *self._shares(held, casts, parcel, target)])
        images, *rows = self.work.results([compared, *(task(shares.extent, s) for s in own)])
        pairs = shares.meeting(dict(enumerate(rows)))
        return Seen.of(_Scattered(self, held.rows, own, pairs), images)

    def linearize(self, grains: PackedGrains, target: Target, pose: Pose) -> Linearization:
        """See `Crew`."""
        held, walk, task = self._hold(grains), target.walk(pose), self.work.task
        pairs = shares.meeting(guessed_rows(grains, pose, walk.geometry, walk.margin, held.rows))
        while True:
            casts, parts = self._parts(held, target, pose)
            parcel = task(shares.compare_and_pack, self._target(target), *parts, pose=_around(pose))
            own = self._shares(held, casts, parcel, target)
            found = self.work.results([task(shares.equations, s, b) for s, b in zip(own, self.loans(own, pairs))])
            actual = shares.meeting({k: f.extent for k, f in enumerate(found)})
            if set(actual) <= set(pairs):
                break
            pairs = actual
        border = in_order(held.rows, [f.border for f in found])
        border = border.reshape(-1, border.shape[2])
        at: shares.Equations = found[0]
        return Linearization(at.cost, -border[:, 0], _matrix(found, len(grains)), border[:, 1:], at.corner, at.slope)

    def each(self, grains: PackedGrains, pose: Pose, function: Callable[..., Float], *images: Image) -> Float:
        """See `Crew`."""
        held = self._hold(grains)
        with self.shelf.lent(images) as lent:
            tasks = [
                self.work.task(shares.each_grain, block, pose=posed(pose, rows), function=function, images=lent)
                for rows, block in zip(held.rows, held.blocks, strict=True)
            ]
            return in_order(held.rows, self.work.results(tasks))

    # ------------------------------------------------------------------ graphs
    def loans(self, own: list[Delayed], pairs: list[tuple[int, int]]) -> list[list[Delayed]]:
        """What each block borrows from those before it."""
        borrowed: list[list[Delayed]] = [[] for _ in own]
        for lender, borrower in pairs:
            borrowed[borrower].append(self.work.task(shares.lend, own[lender], borrower=borrower))
        return borrowed

    def _parts(self, held: Held, target: Target, pose: Pose) -> tuple[list[Delayed], list[Delayed]]:
        """What each block casts, and the last few parts of the sum of their radiographs."""
        walk, task = target.walk(pose), self.work.task
        casts = [
            task(shares.cast_block, block, pose=posed(pose, rows), walk=walk)
            for rows, block in zip(held.rows, held.blocks, strict=True)
        ]
        about = {"views": len(walk.geometry), "shape": walk.geometry.shape, "turned": target.loose.views}
        parts = [task(shares.add_up, cast, block=k, **about) for k, cast in enumerate(casts)]
        while len(parts) > AT_ONCE:  # neighbours first
            groups = [parts[k : k + AT_ONCE] for k in range(0, len(parts), AT_ONCE)]
            parts = [task(shares.merge, *group) if len(group) > 1 else group[0] for group in groups]
        return casts, parts

    def _shares(self, held: Held, casts: list[Delayed], parcel: Delayed, target: Target) -> list[Delayed]:
        """Each block's filtered derivatives; many blocks get their rows of the radiographs, few all of them."""
        task = self.work.task
        many = len(casts) > FEW
        parcels = [task(shares.unpack, parcel, block=k) if many else parcel for k in range(len(casts))]
        return [
            task(shares.share, cast, own, block=k, rows=rows, kernel=target.kernel)
            for k, (cast, own, rows) in enumerate(zip(casts, parcels, held.rows, strict=True))
        ]

    # ------------------------------------------------------------------ what workers hold
    def _hold(self, grains: PackedGrains) -> Held:
        """The blocks of grains, loaded by the workers when they are first asked for."""
        held = self._held.get(grains)
        if held is None:
            rows = block_rows(grains)
            kept = [self.shelf.keep(cut(grains, r).grains, grains) for r in rows]
            held = self._held[grains] = Held(rows, self.work.placed([self.work.task(_take, shelved=k) for k in kept]))
        return held

    def _target(self, target: Target) -> Delayed:
        held = self._targets.get(target)
        if held is None:
            shelved = self.shelf.put(replace(target, crew=ALONE))
            held = self._targets[target] = self.work.persist([self.work.task(_take, shelved=shelved)])[0]
        return held


@dataclass(frozen=True, eq=False)
class _Scattered:
    """What all grains cast, held by workers (`tracking.cast.Shown`)."""

    team: Team
    rows: list[Index]
    shares: list[Delayed]
    pairs: list[tuple[int, int]]

    def each(self, function: Callable[..., Float], *images: Image) -> Float:
        work = self.team.work
        with self.team.shelf.lent(images) as lent:
            tasks = [work.task(shares.each_cast, s, function=function, images=lent) for s in self.shares]
            return in_order(self.rows, work.results(tasks))

    def border(self, columns: Columns) -> Float:
        shared = tuple(columns.shared)
        found = self.each(partial(shares.border_rows, shared=shared), *columns.stacks)
        return found.reshape(6 * len(found), -1)

    def normal_matrix(self) -> sparse.bsr_array:
        work, loans = self.team.work, self.team.loans(self.shares, self.pairs)
        found = work.results([work.task(shares.equations, s, b) for s, b in zip(self.shares, loans)])
        return _matrix(found, sum(map(len, self.rows)))

    def refiltered(self, factor: Image, kernel: Image) -> Shown:
        work, shelf = self.team.work, self.team.shelf
        kept = ShelvedImages(shelf.folder / shelf.write(factor))
        again = work.persist([work.task(shares.refilter, s, factor=kept, kernel=kernel) for s in self.shares])
        return replace(self, shares=again)


def in_order(rows: list[Index], parts: list[Float]) -> Float:
    """Rows of all blocks in the order of the sample."""
    together = np.concatenate(parts)
    out = np.empty_like(together)
    out[np.concatenate(rows)] = together
    return out


def _matrix(found: list[shares.Equations], n: int) -> sparse.bsr_array:
    return block_matrix(np.concatenate([f.pairs for f in found]), np.concatenate([f.blocks for f in found]), n)


def _around(pose: Pose) -> Pose:
    """The surroundings of a pose, without its grains."""
    return Pose(np.zeros((0, 3)), np.zeros((0, 3, 3)), pose.surroundings)


def _take(shelved: Shelved) -> Any:
    return shelved.take()
