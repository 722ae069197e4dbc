"""PatchBackend: the operations on patches of grains that the CPU, a GPU and a Dask cluster offer alike.

Grains, views and patches are the tables of `kernels.layout`.  Arrays over patches stay in the backend's memory:
``values (pixels,)`` are line integrals, ``derivatives (6, pixels)`` those of them by each grain's (u, δ).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grainmotion._typing import Float, Image, Index
from grainmotion.kernels.layout import GrainTable, PatchTable, ViewTable
from grainmotion.model.compact_volume import CompactVoxels
from grainmotion.model.pose import Pose

Grains = TypeVar("Grains")
Settings = TypeVar("Settings")


class BackendArray(Protocol):
    """An array in a backend's memory; indexing and numpy functions use a copy on the host."""

    @property
    def dtype(self) -> np.dtype[np.floating]: ...

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __array__(self) -> NDArray[np.floating]: ...

    def __getitem__(self, index: slice, /) -> NDArray[np.floating]: ...

    def copy(self) -> BackendArray: ...


class ImageStacks(Protocol):
    """Stacks of radiographs ``(views, rows, columns)`` in a backend's memory."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[ArrayLike]: ...


class PatchBackend(Protocol):
    """Where grains are projected and where the normal equations of their motions are built."""

    @property
    def places_coarse_grains(self) -> bool:
        """Whether grains on coarser voxels, too, are placed on it; otherwise the CPU projects them."""
        ...

    @property
    def takes_compact_voxels(self) -> bool:
        """Whether it projects voxels that are kept compactly (`model.compact_volume`)."""
        ...

    def place_voxels(
        self, voxels: Image | CompactVoxels, starts: Index, heights: Float, relative_size: float
    ) -> tuple[PatchBackend, object]:
        """The backend that will project these grains, and their voxels in its memory.

        ``voxels`` are flat, those of each grain from ``starts (n,)`` on, or compact if it `takes_compact_voxels`, those
        of each in row ``starts``; ``heights (n,)`` are the grains' z, and
        ``relative_size`` is the edge of these voxels over that of the reference's.
        """
        ...

    def place_patches(self, patches: PatchTable) -> PatchTable:
        """The table for repeated use: in the memory of the backend where that saves copies."""
        ...

    def project(self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool) -> BackendArray:
        """Line integrals of all patches."""
        ...

    def project_with_derivatives(
        self, grains: GrainTable, views: ViewTable, patches: PatchTable, exact: bool
    ) -> tuple[BackendArray, BackendArray]:
        """Line integrals of all patches and their derivatives by u (1/mm) and δ (1/rad)."""
        ...

    def add_patches(self, values: BackendArray, patches: PatchTable, shape: tuple[int, int, int]) -> Image:
        """Radiographs of a shape (views, rows, columns), on the host: the sum of all patches in their precision."""
        ...

    def filter_images(self, images: Image, kernel: Image) -> None:
        """Filter radiographs ``(n, rows, columns)`` of the host in place; ``kernel`` is half of a symmetric one."""
        ...

    def filter_patches(self, derivatives: BackendArray, patches: PatchTable, factor: Image, kernel: Image) -> None:
        """Multiply by ``factor (views, rows, columns)``, then filter each patch, in place."""
        ...

    def vjp(self, derivatives: BackendArray, patches: PatchTable, stacks: ImageStacks | Sequence[Image]) -> Float:
        """Jᵀ y: dot products ``(k, patches, 6)`` of each patch's derivatives with k stacks of radiographs."""
        ...

    def jvp(
        self, derivatives: BackendArray, patches: PatchTable, increments: Float, shape: tuple[int, int, int]
    ) -> ImageStacks:
        """J x: k stacks of radiographs, of a shape (views, rows, columns), from ``increments (k, n, 6)``.

        They are added up in double precision, and rounded to the derivatives' precision.
        """
        ...

    def gram_blocks(self, derivatives: BackendArray, patches: PatchTable, pairs: Index, first: Index) -> Float:
        """6×6 blocks of JᵀJ: block q sums over the pairs of patches ``pairs[first[q]:first[q + 1]]``."""
        ...

    def map_grains(
        self,
        function: Callable[[Grains, Pose, tuple[Image, ...], Settings], Float],
        grains: Grains,
        pose: Pose,
        images: tuple[Image, ...],
        settings: Settings,
    ) -> Float:
        """``function(grains, pose, images, settings)``, a row a grain, where the grains' voxels are."""
        ...
