"""PatchJacobian: derivatives of line integrals by each grain's motion, and products with them.

The Jacobian J of all radiographs has 6 columns a grain.  Column k of grain g is nonzero in that grain's patches only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from grainmotion._typing import Float, Image, Index
from grainmotion.backends.base import BackendArray, ImageStacks, PatchBackend
from grainmotion.backends.cpu import CPU
from grainmotion.kernels.layout import PatchTable
from grainmotion.projection.footprints import Patches


@dataclass(frozen=True, eq=False)
class PatchJacobian:
    """Derivatives ``(6, pixels)`` by (u, δ) in the ``patches`` of n grains, in the memory of ``backend``."""

    derivatives: BackendArray
    patches: Patches
    backend: PatchBackend = CPU

    def __len__(self) -> int:
        """Number of grains n."""
        return len(self.patches.seen)

    def copy(self) -> PatchJacobian:
        """A copy with derivatives of its own."""
        return replace(self, derivatives=self.derivatives.copy())

    def filter(self, factor: Image, kernel: Image) -> None:
        """Multiply by ``factor (views, rows, columns)``, then filter each patch by a Gaussian, in place."""
        self.backend.filter_patches(self.derivatives, self._placed, factor, kernel)

    def jvp(self, increments: Float) -> ImageStacks:
        """J x: k stacks of radiographs from ``increments (k, n, 6)``, in the backend's memory."""
        increments = np.ascontiguousarray(increments)
        return self.backend.jvp(self.derivatives, self._placed, increments, self.patches.stack_shape)

    def vjp(self, stacks: ImageStacks | Sequence[Image]) -> Float:
        """What each patch adds to Jᵀ y of k stacks of radiographs, ``(k, patches, 6)``."""
        return self.backend.vjp(self.derivatives, self._placed, stacks)

    def gram_blocks(self, pairs: Index, first: Index) -> Float:
        """6×6 blocks of JᵀJ: block q sums over the pairs of patches ``pairs[first[q]:first[q + 1]]``."""
        return self.backend.gram_blocks(self.derivatives, self._placed, pairs, first)

    def images(self, increments: Float) -> list[Image]:
        """J x on the host."""
        return [np.asarray(images) for images in self.jvp(increments)]

    def gradient(self, images: Image) -> Float:
        """Jᵀ y of radiographs, ``(n, 6)``."""
        (parts,) = self.vjp([images])
        return self.by_grain(parts)

    def by_grain(self, parts: Float) -> Float:
        """Sums ``(n, 6)`` over each grain's patches of ``(patches, 6)``."""
        out = np.zeros((len(self), 6))
        np.add.at(out, self.patches.boxes[:, 0], parts)
        return out

    @cached_property
    def _placed(self) -> PatchTable:
        return self.backend.place_patches(self.patches.table)
