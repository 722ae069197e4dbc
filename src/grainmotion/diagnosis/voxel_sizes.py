"""Two voxel sizes of one volume that contradict each other, and the likely cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

MAX_SIZE_DIFFERENCE = 0.02
"""Relative difference of two voxel sizes up to which they are taken for the same, rounded."""
_SIZE_CAUSES: Mapping[float, str] = MappingProxyType({
    1e6: "nm and mm", 1e3: "µm and mm", 10.0: "cm and mm", 100.0: "cm and m, or a slipped decimal point",
    25.4: "inches and mm", 2.54: "inches and cm", 2.0: "a volume binned by 2", 3.0: "a volume binned by 3",
    4.0: "a volume binned by 4", 8.0: "a volume binned by 8",
})  # fmt: skip


def size_conflict(edges: Sequence[float], told: float) -> str:
    """What to add to a sentence on two voxel sizes: the likely cause of their difference; empty if they agree."""
    ratios = [edge / told for edge in edges]
    if all(abs(ratio - 1) <= MAX_SIZE_DIFFERENCE for ratio in ratios):
        return ""
    if max(ratios) > min(ratios) * (1 + MAX_SIZE_DIFFERENCE):
        return ": by the file they are no cubes"
    ratio = max(ratios[0], 1 / ratios[0])
    cause = next((c for factor, c in _SIZE_CAUSES.items() if abs(ratio / factor - 1) <= MAX_SIZE_DIFFERENCE), None)
    return f", {ratio:.4g} times apart" + (f": probably {cause}" if cause else "")
