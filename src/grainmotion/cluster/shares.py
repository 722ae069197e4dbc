"""What workers do of one evaluation of a state: plain functions from nouns to nouns that know no Dask.

    cast_block ─┬─ add_up ── merge (a tree) ── compare ── parcel of each block
                └────────────────────────────────── share ──┴─┬─ lend to blocks it overlaps with
                                                              └─ equations, with what it was lent

Radiographs travel as the rows that a block shades, in double precision while they are summed: sums of numbers in
single precision are exact then, and do not depend on how they were made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.cluster.shelf import ShelvedImages
from grainmotion.cluster.threads import own_threads
from grainmotion.kernels import grains as kernel
from grainmotion.packed import Image, PackedGrains, Pose
from grainmotion.tracking.cast import Cast, Walk
from grainmotion.tracking.columns import Columns
from grainmotion.tracking.coupling import coupling_blocks
from grainmotion.tracking.target import Compared, Target

Float = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Part:
    """Rows ``first …`` of all radiographs, summed over some blocks: ``sums (k, views, rows, columns)``.

    They are line integrals and, if views are loose, derivatives by the stage's angle, both of ``precision``, of which
    sums in double precision are exact if it is single.  ``boxes`` are the patches of each block so far, by its number.
    """

    first: int
    sums: Float
    boxes: dict[int, Index]
    precision: np.dtype[np.floating]

    @property
    def end(self) -> int:
        """The row after the last."""
        return self.first + self.sums.shape[2]


@dataclass(frozen=True, eq=False)
class Parcel:
    """What blocks need of the radiographs: rows ``first …`` of the images, and all patches by block.

    The residual comes first among the ``columns``.  ``cost``, ``corner`` and ``slope`` are those of
    `solve.Linearization`.
    """

    first: int
    factor: Image
    columns: Columns
    boxes: dict[int, Index]
    cost: float
    corner: Float
    slope: Float

    @property
    def rows(self) -> dict[int, tuple[int, int]]:
        """Rows of pixels that each block touches."""
        return {block: rows_of(patches) for block, patches in self.boxes.items()}


@dataclass(frozen=True, eq=False)
class Share:
    """One block's part of the normal equations under way: its filtered cast, and what its parcel brought.

    ``rows`` are its grains in the sample.
    """

    block: int
    cast: Cast
    rows: Index
    parcel: Parcel


@dataclass(frozen=True, eq=False)
class Equations:
    """One block's rows of the normal equations, and what it was told of the whole.

    ``extent`` are the rows of pixels that it touches, ``border (n, 6, m)`` its rows of JᵀC, residual first,
    ``pairs (k, 2)`` of grains as in the sample and their ``blocks (k, 6, 6)`` those of JᵀJ that it is in charge of.
    """

    cost: float
    corner: Float
    slope: Float
    extent: tuple[int, int]
    border: Float
    pairs: Index
    blocks: Float


@dataclass(frozen=True, eq=False)
class Loan:
    """Filtered derivatives of some patches; the grains in ``boxes`` are numbered as in the sample."""

    boxes: Index
    derivatives: Image


# ---------------------------------------------------------------------- what grains cast
def cast_block(grains: PackedGrains, pose: Pose, walk: Walk) -> Cast:
    """Walk the rays of one block."""
    with own_threads():
        return Cast.of(grains, pose, walk)


def add_up(cast: Cast, block: int, views: int, shape: tuple[int, int], turned: bool) -> Part:
    """The radiographs of one block."""
    boxes = cast.patches.boxes
    first, end = rows_of(boxes)
    here = _lowered(boxes, first)
    stacks = [cast.values, cast.turned()] if turned else [cast.values]
    sums = np.zeros((len(stacks), views, end - first, shape[1]))
    for out, values in zip(sums, stacks, strict=True):
        kernel.add_patches(values, here, cast.patches.offsets, out)
    return Part(first, sums, {block: boxes}, cast.values.dtype)


def merge(*parts: Part) -> Part:
    """The sum of some parts, in their order."""
    filled = [p for p in parts if p.sums.shape[2]] or list(parts[:1])
    first, end = min(p.first for p in filled), max(p.end for p in filled)
    k, views, _, columns = parts[0].sums.shape
    sums = np.zeros((k, views, end - first, columns))
    boxes: dict[int, Index] = {}
    for part in filled:
        sums[:, :, part.first - first : part.end - first] += part.sums
    for part in parts:
        boxes |= part.boxes
    return Part(first, sums, boxes, parts[0].precision)


# ---------------------------------------------------------------------- whole radiographs
def compare(target: Target, *parts: Part, pose: Pose) -> Compared:
    """Compare with what was measured; of the pose, the surroundings alone count."""
    part = merge(*parts)
    whole = np.zeros((len(part.sums), *target.scan.line_integrals.shape), part.precision)
    whole[:, :, part.first : part.end] = part.sums
    with own_threads():
        return target.compare(pose, whole[0], whole[1] if len(whole) > 1 else None)


def parcel(compared: Compared, *parts: Part) -> Parcel:
    """What all blocks need of the radiographs, whole; ``parts`` say where the blocks are."""
    columns = Columns([compared.residual], [True]) + compared.columns
    boxes = {block: patches for part in parts for block, patches in part.boxes.items()}
    slope = -compared.loose.dot(compared.residual)
    return Parcel(0, compared.factor, columns, boxes, compared.cost, compared.columns.gram(), slope)


def compare_and_pack(target: Target, *parts: Part, pose: Pose) -> Parcel:
    """Both at once."""
    return parcel(compare(target, *parts, pose=pose), *parts)


def unpack(whole: Parcel, block: int) -> Parcel:
    """What one block needs of a parcel: its rows, and the patches of its own and of those that borrow from it."""
    first, end = rows_of(whole.boxes[block])
    boxes = {block: whole.boxes[block]} | {b: whole.boxes[b] for a, b in meeting(whole.rows) if a == block}
    columns = Columns([_rows(stack, first, end) for stack in whole.columns.stacks], whole.columns.shared)
    return replace(whole, first=first, factor=_rows(whole.factor, first, end), columns=columns, boxes=boxes)


# ---------------------------------------------------------------------- normal equations
def share(cast: Cast, parcel: Parcel, block: int, rows: Index, kernel: Image) -> Share:
    """Weight and filter the derivatives of one block."""
    own = replace(cast, derivatives=cast.derivatives.copy())
    with own_threads():
        lowered(own, parcel.first).filter(parcel.factor, kernel)
    return Share(block, own, rows, parcel)


def lend(lender: Share, borrower: int) -> Loan:
    """The patches that overlap with any of another block's."""
    theirs = lender.parcel.boxes.get(borrower, np.zeros((0, 6), np.int64))
    return _loan(lender, overlapping(lender.cast.patches.boxes, theirs))


def equations(own: Share, loans: list[Loan]) -> Equations:
    """The rows of one block, with what others lent it."""
    cast, at = lowered(own.cast, own.parcel.first), own.parcel
    with own_threads():
        border = cast.border(at.columns).reshape(len(own.rows), 6, -1)
    return Equations(at.cost, at.corner, at.slope, rows_of(own.cast.patches.boxes), border, *couple(own, loans))


def couple(own: Share, loans: list[Loan]) -> tuple[Index, Float]:
    """Pairs of grains, as in the sample, and their 6×6 blocks: own grains, and own with borrowed ones."""
    mine = _loan(own, np.ones(len(own.cast.patches.boxes), bool))
    boxes = np.concatenate([mine.boxes, *(loan.boxes for loan in loans)])
    borrowed = any(len(loan.boxes) for loan in loans)
    derivatives = [mine.derivatives, *(loan.derivatives for loan in loans)]
    flat = np.concatenate(derivatives, axis=1) if borrowed else mine.derivatives
    sizes = (boxes[:, 3] - boxes[:, 2]) * (boxes[:, 5] - boxes[:, 4])
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    with own_threads():
        return coupling_blocks(flat, boxes, offsets, np.arange(len(boxes)) < len(mine.boxes))


# ---------------------------------------------------------------------- anything else
def each_cast(own: Share, function: Callable[..., Float], images: list[ShelvedImages]) -> Float:
    """A function of one block's cast and of images, of which it reads its rows."""
    first, end = rows_of(own.cast.patches.boxes)
    with own_threads():
        return function(lowered(own.cast, first), *(image.rows(first, end) for image in images))


def each_grain(grains: PackedGrains, pose: Pose, function: Callable[..., Float], images: list[ShelvedImages]) -> Float:
    """A function of one block's grains at a pose and of images."""
    with own_threads():
        return function(grains, pose, *(image.all() for image in images))


def extent(own: Share) -> tuple[int, int]:
    """Rows of pixels that one block touches."""
    return rows_of(own.cast.patches.boxes)


def refilter(own: Share, factor: ShelvedImages, kernel: Image) -> Share:
    """See `Shown.refiltered`."""
    first, end = rows_of(own.cast.patches.boxes)
    with own_threads():
        again = lowered(own.cast, first).refiltered(factor.rows(first, end), kernel)
    return replace(own, cast=replace(own.cast, derivatives=again.derivatives))


def border_rows(cast: Cast, *stacks: Image, shared: tuple[bool, ...]) -> Float:
    """Rows of JᵀC of one block, ``(n, 6, m)``."""
    return cast.border(Columns(list(stacks), list(shared))).reshape(len(cast.grains), 6, -1)


# ---------------------------------------------------------------------- small parts
def rows_of(boxes: Index) -> tuple[int, int]:
    """First row and the row after the last that patches touch in any view."""
    return (int(boxes[:, 2].min()), int(boxes[:, 3].max())) if len(boxes) else (0, 0)


def meeting(rows: dict[int, tuple[int, int]]) -> list[tuple[int, int]]:
    """Pairs of blocks, first < second, whose rows meet."""
    numbers = sorted(rows)
    return [
        (one, other)
        for k, one in enumerate(numbers)
        for other in numbers[k + 1 :]
        if rows[one][0] < rows[other][1] and rows[other][0] < rows[one][1]
    ]


def overlapping(boxes: Index, others: Index) -> NDArray[np.bool_]:
    """Which patches share pixels with any of the others."""
    out = np.zeros(len(boxes), bool)
    for view in np.unique(others[:, 1]) if len(others) else []:
        index = np.nonzero(boxes[:, 1] == view)[0]
        mine, theirs = boxes[index][:, None], others[others[:, 1] == view][None]
        meets = (mine[..., 2] < theirs[..., 3]) & (mine[..., 3] > theirs[..., 2])
        meets &= (mine[..., 4] < theirs[..., 5]) & (mine[..., 5] > theirs[..., 4])
        out[index] = meets.any(axis=1)
    return out


def lowered(cast: Cast, first: int) -> Cast:
    """The cast with patches counted from a first row; arrays are shared."""
    return replace(cast, patches=replace(cast.patches, boxes=_lowered(cast.patches.boxes, first)))


def _rows(stack: Image, first: int, end: int) -> Image:
    return np.ascontiguousarray(stack[:, first:end])


def _lowered(boxes: Index, first: int) -> Index:
    out = boxes.copy()
    out[:, 2:4] -= first
    return out


def _loan(lender: Share, chosen: NDArray[np.bool_]) -> Loan:
    patches, derivatives = lender.cast.patches, lender.cast.derivatives
    boxes = patches.boxes[chosen].copy()
    boxes[:, 0] = lender.rows[boxes[:, 0]]
    if not chosen.all():
        sizes: NDArray[Any] = np.diff(patches.offsets)
        derivatives = derivatives[:, np.repeat(chosen, sizes)]
    return Loan(boxes, derivatives)
