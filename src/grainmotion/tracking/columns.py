"""Columns: the few unknowns of a state as a whole, as images, and what is eliminated of them.

A stack of images ``(views, rows, columns)`` is one unknown if all views share it, and one a view if not.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.packed import Image
from grainmotion.patchwork import gradients
from grainmotion.project import Patches

Float = NDArray[np.float64]
DEFICIENT = 1e-9
"""Share of the largest eigenvalue below which the scaled Gram matrix says nothing."""


@dataclass(eq=False)
class Columns:
    """Stacks of weighted and filtered images, and whether the views share them."""

    stacks: list[Image] = field(default_factory=list)
    shared: list[bool] = field(default_factory=list)

    def add(self, stack: Image, shared: bool) -> None:
        """Append a stack."""
        self.stacks.append(stack)
        self.shared.append(shared)

    def __add__(self, other: Columns) -> Columns:
        return Columns(self.stacks + other.stacks, self.shared + other.shared)

    @property
    def views(self) -> int:
        """Number of views."""
        return len(self.stacks[0]) if self.stacks else 0

    @property
    def owners(self) -> NDArray[np.int64]:
        """Stack of each unknown ``(m,)``."""
        counts = [1 if s else self.views for s in self.shared]
        return np.repeat(np.arange(len(counts)), counts)

    def dot(self, image: Image) -> Float:
        """Cᵀ image, ``(m,)``."""
        parts = [_view_dots(stack, image) for stack in self.stacks]
        return _folded(parts, self.shared)

    def gram(self) -> Float:
        """CᵀC, ``(m, m)``."""
        starts = np.cumsum([0, *(1 if s else self.views for s in self.shared)])
        out = np.zeros((starts[-1], starts[-1]))
        for i, left in enumerate(self.stacks):
            for j in range(i, len(self.stacks)):
                dots = _view_dots(left, self.stacks[j])
                block = np.diag(dots)
                block = block.sum(axis=0, keepdims=True) if self.shared[i] else block
                block = block.sum(axis=1, keepdims=True) if self.shared[j] else block
                out[starts[i] : starts[i + 1], starts[j] : starts[j + 1]] = block
                out[starts[j] : starts[j + 1], starts[i] : starts[i + 1]] = block.T
        return out

    def border(self, derivatives: Any, patches: Patches, grains: int) -> Float:
        """JᵀC, ``(6n, m)``, for filtered derivatives in patches."""
        grain, view = patches.boxes[:, 0], patches.boxes[:, 1]
        blocks = []
        found: list[Float] = []
        if self.stacks:
            found = list(gradients(derivatives, patches.boxes, patches.offsets, self.stacks))
        for parts, shared in zip(found, self.shared, strict=True):
            block = np.zeros((grains, 1 if shared else self.views, 6))
            np.add.at(block, (grain, np.zeros_like(view) if shared else view), parts)
            blocks.append(block.transpose(0, 2, 1).reshape(6 * grains, -1))
        return np.concatenate(blocks, axis=1) if blocks else np.zeros((6 * grains, 0))

    def combine(self, coefficients: Float) -> Image:
        """C coefficients, as images."""
        out = np.zeros_like(self.stacks[0])
        at = 0
        for stack, shared in zip(self.stacks, self.shared, strict=True):
            count = 1 if shared else self.views
            out += coefficients[at : at + count].astype(stack.dtype)[:, None, None] * stack
            at += count
        return out


def minimum_norm(gram: Float, dots: Float) -> Float:
    """Least squares solution of smallest norm, in units in which every column has length 1."""
    scale = np.sqrt(np.diagonal(gram))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    values, vectors = np.linalg.eigh(gram * np.outer(inverse, inverse))
    kept = values > DEFICIENT * max(float(values.max(initial=0.0)), DEFICIENT)
    solved = vectors[:, kept] @ ((vectors[:, kept].T @ (inverse * dots)) / values[kept])
    return inverse * solved


def _view_dots(left: Image, right: Image) -> Float:
    return np.array([np.vdot(a, b) for a, b in zip(left, right, strict=True)], dtype=float)


def _folded(parts: list[Float], shared: list[bool]) -> Float:
    folded = [[p.sum()] if s else p for p, s in zip(parts, shared, strict=True)]
    return np.concatenate(folded) if folded else np.zeros(0)
