"""Global parameters: the few unknowns of a state as a whole, as columns C of its Jacobian that are images.

A stack of images ``(views, rows, columns)`` is one unknown if all views share it, and one a view if not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.projection.jacobian import PatchJacobian


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
        dots = [_view_dots(stack, image.astype(float, copy=False)) for stack in self.stacks]
        unknowns = [[d.sum()] if s else d for d, s in zip(dots, self.shared, strict=True)]
        return np.concatenate(unknowns) if unknowns else np.zeros(0)

    def gram(self) -> Float:
        """CᵀC, ``(m, m)``."""
        starts = np.cumsum([0, *(1 if s else self.views for s in self.shared)])
        out = np.zeros((starts[-1], starts[-1]))
        doubles = [stack.astype(float, copy=False) for stack in self.stacks]
        for i, left in enumerate(doubles):
            for j in range(i, len(doubles)):
                dots = _view_dots(left, doubles[j])
                block = np.diag(dots)
                block = block.sum(axis=0, keepdims=True) if self.shared[i] else block
                block = block.sum(axis=1, keepdims=True) if self.shared[j] else block
                out[starts[i] : starts[i + 1], starts[j] : starts[j + 1]] = block
                out[starts[j] : starts[j + 1], starts[i] : starts[i + 1]] = block.T
        return out

    def border(self, jacobian: PatchJacobian) -> Float:
        """JᵀC, ``(6n, m)``, for a filtered Jacobian J."""
        grain, view = jacobian.patches.boxes[:, 0], jacobian.patches.boxes[:, 1]
        blocks = [np.zeros((6 * len(jacobian), 0))]
        for parts, shared in zip(jacobian.vjp(self.stacks) if self.stacks else [], self.shared, strict=True):
            block = np.zeros((len(jacobian), 1 if shared else self.views, 6))
            np.add.at(block, (grain, np.zeros_like(view) if shared else view), parts)
            blocks.append(block.transpose(0, 2, 1).reshape(6 * len(jacobian), -1))
        return np.concatenate(blocks, axis=1)

    def on_patches(self, jacobian: PatchJacobian, coefficients: Float) -> Float:
        """JᵀC coefficients ``(m, k)`` of each patch, ``(k, patches, 6)``."""
        view = jacobian.patches.boxes[:, 1]
        out, at = np.zeros((coefficients.shape[1], len(view), 6)), 0
        for parts, shared in zip(jacobian.vjp(self.stacks) if self.stacks else [], self.shared, strict=True):
            count = 1 if shared else self.views
            own = coefficients[at : at + count][np.zeros_like(view) if shared else view]
            out += own.T[:, :, None] * parts
            at += count
        return out

    def combine(self, coefficients: Float) -> Image:
        """C coefficients, as images."""
        out = np.zeros_like(self.stacks[0])
        at = 0
        for stack, shared in zip(self.stacks, self.shared, strict=True):
            count = 1 if shared else self.views
            out += coefficients[at : at + count].astype(stack.dtype)[:, None, None] * stack
            at += count
        return out


def dot(left: Image, right: Image) -> float:
    """Sum of the products of two images or stacks, added up in double precision."""
    return float(np.vdot(left.astype(float, copy=False), right.astype(float, copy=False)))


def _view_dots(left: Image, right: Image) -> Float:
    """The same view by view, ``(views,)``."""
    return np.array([dot(a, b) for a, b in zip(left, right, strict=True)])
