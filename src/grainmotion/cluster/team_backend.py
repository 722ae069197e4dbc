"""TeamBackend: the members of a team as a backend, each of which projects a share of the grains.

All members run the same code with the same arguments.  Each holds the voxels of all grains, but line integrals and
derivatives of its own alone: neighbours in the table of patches.  Sums over patches are taken in double precision,
which is exact for single numbers, so that the results of all members are those of one process, bit by bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.base import BackendArray, Grains, ImageStacks, PatchBackend, Settings
from grainmotion.backends.cpu import CPU
from grainmotion.backends.image_sums import in_precision
from grainmotion.cluster.team import Team
from grainmotion.cluster.tracking_tasks import ImageStrip, below, rows_of
from grainmotion.kernels import grain_projection, normal_equations
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable, patch_table
from grainmotion.model.compact_volume import CompactVoxels
from grainmotion.model.pose import Pose
from grainmotion.projection.grain_arrays import GrainArrays

MIN_GRAINS_SHARED = 101
"""Grains from which members share the projection; the normal matrix of fewer is made of pairs of all patches."""


@dataclass(frozen=True, eq=False)
class Shares:
    """Which patches are whose: member m has those from ``edges[m]`` to ``edges[m + 1]``, in ``rows[m]`` of pixels.

    ``own`` are this member's, with offsets into the arrays of all patches.
    """

    patches: PatchTable
    edges: Index
    rows: list[tuple[int, int]]
    own: PatchTable


@dataclass(eq=False)
class TeamArray:
    """An array over all patches ``(…, pixels)``, of which this member has its own part; indexing asks for the rest."""

    team: Team
    own: Image
    shares: Shares

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """Of its numbers."""
        return self.own.dtype

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the whole."""
        return self.own.shape

    @cached_property
    def host(self) -> Image:
        """The whole array."""
        ends = self.shares.patches.offsets[self.shares.edges]
        out, mine = self.own.copy(), slice(ends[self.team.rank], ends[self.team.rank + 1])
        for other, part in self.team.exchange(lambda _: self.own[..., mine]).items():
            out[..., ends[other] : ends[other + 1]] = part
        return out

    def copy(self) -> TeamArray:
        """An array of its own."""
        return replace(self, own=self.own.copy())

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[np.floating]:
        return self.host.astype(dtype or self.dtype, copy=bool(copy))

    def __getitem__(self, index: slice) -> NDArray[np.floating]:
        return self.host[index]

    def __len__(self) -> int:
        return len(self.own)


@dataclass(frozen=True, eq=False)
class TeamSum:
    """k stacks of radiographs, ``shape`` (k, views, rows, columns): the sum of what each member has in its rows."""

    team: Team
    part: ImageStrip
    shares: Shares
    shape: tuple[int, ...]
    dtype: np.dtype[np.floating]

    @cached_property
    def own_rows(self) -> Image:
        """The sums in this member's rows."""
        parts = self._in_order(self.team.exchange(self._rows_for))
        first, end = self.shares.rows[self.team.rank]
        out = in_precision(self.part.images, self.dtype)
        for low, high in self._common_rows(first, end):
            sums = np.zeros((*self.shape[:2], high - low, self.shape[3]))
            for member, images in parts:
                ImageStrip(max(self.shares.rows[member][0], first), images).add_to(sums, low)
            out[:, :, low - first : high - first] = in_precision(sums, self.dtype)
        return out

    @cached_property
    def host(self) -> Image:
        """The sums in all rows."""
        out = np.zeros(self.shape)
        for member, images in self._in_order(self.team.exchange(lambda _: self.part.images)):
            ImageStrip(self.shares.rows[member][0], images).add_to(out)
        return in_precision(out, self.dtype)

    def _common_rows(self, first: int, end: int) -> list[tuple[int, int]]:
        """Runs of this member's rows that others have, too."""
        common = np.zeros(end - first + 2, bool)
        for member, (low, high) in enumerate(self.shares.rows):
            if member != self.team.rank:
                common[1:-1][max(low - first, 0) : max(high - first, 0)] = True
        edges = first + np.flatnonzero(np.diff(common)).reshape(-1, 2)
        return [(int(low), int(high)) for low, high in edges]

    def _in_order(self, others: dict[int, Float]) -> list[tuple[int, Float]]:
        """The parts of all members in one order, so that all get the same sums also where these are not exact."""
        return sorted({**others, self.team.rank: self.part.images}.items())

    def _rows_for(self, other: int) -> Float:
        """What this member has in another one's rows."""
        (first, end), (low, high) = self.shares.rows[self.team.rank], self.shares.rows[other]
        begin = max(first, low)
        return self.part.images[:, :, begin - first : max(min(end, high), begin) - first]

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[ArrayLike]:
        return iter(self.host)


@dataclass(frozen=True, eq=False)
class TeamBackend:
    """A `PatchBackend` of a team; fewer grains than ``least`` are projected by each member."""

    team: Team
    least: int = MIN_GRAINS_SHARED
    places_coarse_grains = True
    takes_compact_voxels = True
    _last: list[Shares] = field(default_factory=list)

    def place_voxels(
        self, voxels: Image | CompactVoxels, starts: Index, heights: Float, relative_size: float
    ) -> tuple[PatchBackend, object]:
        """See `PatchBackend`."""
        return self, voxels

    def place_patches(self, patches: PatchTable) -> PatchTable:
        """See `PatchBackend`."""
        return patches

    def project(self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool) -> BackendArray:
        """See `PatchBackend`."""
        shares = self._shares(patches)
        if shares is None:
            return CPU.project(grains, views, patches, exact)
        return TeamArray(self.team, CPU.project(grains, views, self._traced(shares), exact), shares)

    def project_with_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[BackendArray, BackendArray]:
        """See `PatchBackend`."""
        shares = self._shares(patches)
        if shares is None:
            return CPU.project_with_derivatives(grains, views, patches, exact)
        values, derivatives = CPU.project_with_derivatives(grains, views, self._traced(shares), exact)
        return TeamArray(self.team, values, shares), TeamArray(self.team, derivatives, shares)

    def add_patches(self, values: BackendArray, patches: PatchTable, shape: tuple[int, int, int]) -> Image:
        """See `PatchBackend`."""
        if not isinstance(values, TeamArray):
            return CPU.add_patches(values, patches, shape)
        shares = values.shares
        first, end = shares.rows[self.team.rank]
        images = np.zeros((1, shape[0], end - first, shape[2]))
        grain_projection.add_patches(values.own, below(shares.own, first).boxes, shares.own.offsets, images[0])
        return TeamSum(self.team, ImageStrip(first, images), shares, (1, *shape), values.dtype).host[0]

    def filter_images(self, images: Image, kernel: Image) -> None:
        """See `PatchBackend`."""
        CPU.filter_images(images, kernel)

    def filter_patches(self, derivatives: BackendArray, patches: PatchTable, factor: Image, kernel: Image) -> None:
        """See `PatchBackend`."""
        if not isinstance(derivatives, TeamArray):
            CPU.filter_patches(derivatives, patches, factor, kernel)
            return
        CPU.filter_patches(derivatives.own, derivatives.shares.own, factor, kernel)
        derivatives.__dict__.pop("host", None)

    def vjp(self, derivatives: BackendArray, patches: PatchTable, stacks: ImageStacks | Sequence[Image]) -> Float:
        """See `PatchBackend`."""
        if not isinstance(derivatives, TeamArray):
            return CPU.vjp(derivatives, patches, list(map(np.asarray, stacks)))
        shares, rank = derivatives.shares, self.team.rank
        first, end = shares.rows[rank]
        if isinstance(stacks, TeamSum):
            images = list(stacks.own_rows)
        else:
            images = [np.ascontiguousarray(np.asarray(image)[:, first:end]) for image in stacks]
        out, edges = np.zeros((len(stacks), len(patches.boxes), 6)), shares.edges
        own = out[:, edges[rank] : edges[rank + 1]]
        own[:] = CPU.vjp(derivatives.own, below(shares.own, first), images)
        for other, part in self.team.exchange(lambda _: own).items():
            out[:, edges[other] : edges[other + 1]] = part
        return out

    def jvp(
        self, derivatives: BackendArray, patches: PatchTable, increments: Float, shape: tuple[int, int, int]
    ) -> ImageStacks:
        """See `PatchBackend`; each member keeps its part until somebody asks for the sum."""
        if not isinstance(derivatives, TeamArray):
            return CPU.jvp(derivatives, patches, increments, shape)
        shares = derivatives.shares
        first, end = shares.rows[self.team.rank]
        images = np.zeros((len(increments), shape[0], end - first, shape[2]))
        own = below(shares.own, first)
        tables = own.boxes, own.offsets, own.order, own.view_starts
        normal_equations.jvp(derivatives.own, *tables, np.ascontiguousarray(increments), images)
        whole = len(increments), *shape
        return TeamSum(self.team, ImageStrip(first, images), shares, whole, derivatives.dtype)

    def gram_blocks(self, derivatives: BackendArray, patches: PatchTable, pairs: Index, first: Index) -> Float:
        """See `PatchBackend`; blocks of pairs of patches that two members have are made by all."""
        if not isinstance(derivatives, TeamArray):
            return CPU.gram_blocks(derivatives, patches, pairs, first)
        owners = np.searchsorted(derivatives.shares.edges, pairs, side="right") - 1
        filled = np.flatnonzero(np.diff(first))
        makers = owners[first[filled], 0]
        if (owners != np.repeat(makers, np.diff(first)[filled])[:, None]).any():
            return CPU.gram_blocks(derivatives.host, patches, pairs, first)
        out, mine = np.zeros((len(first) - 1, 6, 6)), filled[makers == self.team.rank]
        counts = first[mine + 1] - first[mine]
        ends = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        own = pairs[np.repeat(first[mine] - ends[:-1], counts) + np.arange(ends[-1])]
        out[mine] = CPU.gram_blocks(derivatives.own, patches, own, ends)
        for other, part in self.team.exchange(lambda _: out[mine]).items():
            out[filled[makers == other]] = part
        return out

    def map_grains(
        self,
        function: Callable[[Grains, Pose, tuple[Image, ...], Settings], Float],
        grains: Grains,
        pose: Pose,
        images: tuple[Image, ...],
        settings: Settings,
    ) -> Float:
        """See `PatchBackend`; rows of one grain stay together."""
        assert isinstance(grains, GrainArrays)
        alone = replace(grains, backend=CPU, placed=None)
        begins = np.flatnonzero(np.diff(grains.starts, prepend=-1))
        if len(begins) < self.team.size:
            return function(cast("Grains", alone), pose, images, settings)
        shares = np.arange(1, self.team.size) * len(begins) // self.team.size
        edges = [0, *begins[shares].tolist(), len(grains)]
        rows = np.arange(edges[self.team.rank], edges[self.team.rank + 1])
        here = pose.moved(pose.translations[rows], pose.matrices[rows])
        own = function(cast("Grains", alone.select(rows)), here, images, settings)
        parts = {self.team.rank: own, **self.team.exchange(lambda _: own)}
        return np.concatenate([parts[member] for member in range(self.team.size)])

    def _shares(self, patches: PatchTable) -> Shares | None:
        """Who has which patches, about the same number of pixels each; None if each member has all of them."""
        for known in self._last:
            if known.patches.boxes is patches.boxes:
                return known
        begins = np.flatnonzero(np.diff(patches.boxes[:, 0], prepend=-1))  # patches follow their grains
        if self.team.size == 1 or len(begins) < max(self.least, self.team.size):
            return None
        share = patches.offsets[begins] / patches.offsets[-1]
        cuts = np.append(begins, len(patches.boxes))[
            np.searchsorted(share, np.arange(1, self.team.size) / self.team.size)
        ]
        edges = np.concatenate([[0], cuts, [len(patches.boxes)]]).astype(np.int64)
        tables = [_slice_of(patches, *edges[m : m + 2].tolist()) for m in range(self.team.size)]
        rows = [rows_of(table) if len(table.boxes) else (0, 0) for table in tables]
        self._last[:] = [Shares(patches, edges, rows, tables[self.team.rank]), *self._last[:1]]
        return self._last[0]

    def _traced(self, shares: Shares) -> PatchTable:
        """All patches, with the lines of this member's alone."""
        lines = shares.patches.lines
        first, end = np.searchsorted(lines[:, 0], shares.edges[self.team.rank : self.team.rank + 2])
        return shares.patches._replace(lines=lines[first:end])


def _slice_of(patches: PatchTable, first: int, end: int) -> PatchTable:
    """Some patches that follow each other, with their places in the arrays of all."""
    table = patch_table(patches.boxes[first:end], patches.lines[:0], len(patches.view_starts) - 1)
    return table._replace(offsets=patches.offsets[first : end + 1])
