"""Labels that have not as many voxels as their volume: the likely cause."""

from __future__ import annotations

MAX_MARGIN = 16
"""Voxels that programs cut off or add along an axis."""
BINNINGS = (2, 3, 4, 8)


def shape_hint(labels: tuple[int, int, int], volume: tuple[int, int, int]) -> str:
    """What to add to a sentence on two shapes: the likely cause of their difference; empty if there is none."""
    if sorted(labels) == sorted(volume):
        order = "x y z" if labels == volume[::-1] else "another order"
        return f": probably their axes are in another order, as {order}" if order == "x y z" else f": axes in {order}"
    for factor in BINNINGS:
        if _binned(labels, volume, factor):
            return f": probably they are of the volume binned by {factor}; repeat each {factor} times along each axis"
        if _binned(volume, labels, factor):
            step = ", ".join([f"::{factor}"] * 3)
            return f": probably the volume was binned by {factor}, the labels were not; give labels[{step}]"
    more = [a - b for a, b in zip(labels, volume)]
    if max(more) <= 0 and min(more) >= -MAX_MARGIN:
        return f": probably they were cropped by {tuple(-m for m in more)} voxels (z, y, x)"
    if min(more) >= 0 and max(more) <= MAX_MARGIN:
        return f": probably they were padded by {tuple(more)} voxels (z, y, x)"
    if labels[1:] == volume[1:]:
        return f": {abs(more[0])} slices {'are missing' if more[0] < 0 else 'too many'}"
    return ""


def _binned(small: tuple[int, ...], large: tuple[int, ...], factor: int) -> bool:
    """Whether a shape is another one over a factor, rounded down or up."""
    return all(n // factor <= s <= -(-n // factor) for s, n in zip(small, large))
