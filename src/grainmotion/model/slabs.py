"""Some planes of a volume at a time, with planes beside them as far as a filter reaches."""

from __future__ import annotations

from collections.abc import Iterator

from grainmotion.model.progress import counted

PLANES_TOGETHER = 64
"""Planes of a slab unless told otherwise: few in a volume that is large, and many against usual margins."""


def slabs(planes: int, margin: int = 0, together: int = PLANES_TOGETHER) -> Iterator[tuple[slice, slice]]:
    """Slabs that fill a volume, each with a margin.

    Parameters
    ----------
    planes : int
        Of the volume.
    margin : int
        Planes that a filter reaches.
    together : int
        Planes of a slab.

    Yields
    ------
    around, inner : slice
        The planes with the margin as far as there are any, and the slab's own, counted from the first of these.
    """
    for first in counted(range(0, planes, together)):
        start, stop = max(first - margin, 0), min(first + together, planes)
        yield slice(start, min(stop + margin, planes)), slice(first - start, stop - start)
