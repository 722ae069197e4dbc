"""Neighbouring radiographs that differ by noise alone: a stage or camera that was stuck, or one view taken twice."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.diagnosis.read_scan import ReadScan
from grainmotion.model.finding import Finding, Level

MIN_VIEWS_WITH_NEIGHBOURS = 16
"""Views from which neighbours can be expected to be alike."""
STUCK_SHARE = 0.36
"""Difference of neighbouring views over that of those around them, below which they show the same view.

Sound scans gave 0.6 to 1.3, six near-spherical grains 0.41; a view taken twice 0.11 to 0.31 at usual noise, and 0.45
to 0.9, which is not told, where noise is a twentieth of the beam."""
STUCK_NEIGHBOURHOOD = 8
"""Differences before and after one that it is compared with."""
MAX_SUDDEN_SHARE = 0.5
"""Difference of views that show the same over those just before and after, at most.  Where rays pass along rows of
grains, views hardly change from one to the next: there the differences fall and rise again from view to view, with
0.65 of the next at the least (1000 views of grains on a lattice)."""
MAX_STUCK_VIEWS_SHARE = 0.2
"""Share of stuck views; if there are more, the odd thing is the scan."""
MIN_TOLD_STEP = 0.5
"""Step between two views in the geometry, over the median, from which their radiographs should differ."""
MAX_STUCK_NAMED = 8
"""Pairs that a sentence names."""


def stuck_views(read: ReadScan) -> Iterable[Finding]:
    """Pairs of neighbouring views that show the same, though not with the same noise."""
    lit = np.flatnonzero(~read.black)
    if len(lit) < MIN_VIEWS_WITH_NEIGHBOURS:
        return
    vectors = read.scan.geometry.vectors[lit]
    steps = np.linalg.norm(np.diff(vectors, axis=0), axis=1)
    ratio = step_ratios(read.blocks[lit])
    found = np.flatnonzero(equal_neighbours(ratio) & (steps > MIN_TOLD_STEP * np.median(steps)))
    copies = [k for k in found if np.array_equal(read.images[lit[k]], read.images[lit[k + 1]])]
    pairs = [(int(lit[k]), int(lit[k + 1])) for k in found if k not in copies]
    if not pairs or len(found) > MAX_STUCK_VIEWS_SHARE * len(lit):
        return
    more = f" and {len(pairs) - MAX_STUCK_NAMED} more" if len(pairs) > MAX_STUCK_NAMED else ""
    text = ", ".join(f"{a} and {b}" for a, b in pairs[:MAX_STUCK_NAMED]) + more
    yield Finding(
        Level.WARNING, "frames", read.names["radiographs"],
        f"radiographs {text} (from 0) differ by noise alone, though their angles differ: stage or camera was stuck, or "
        "one view was taken twice",
        f"they differ by {', '.join(f'{r:.2f}' for r in ratio[found][:MAX_STUCK_NAMED])} of what views around them do",
        "if a view was inserted, all later ones have wrong angles: correct angles_deg; else leave the copies out by "
        f"{read.key}.views",
    )  # fmt: skip


def step_ratios(blocks: Float) -> Float:
    """Difference of each view from the next, but for its level, over the median of those around ``(views - 1,)``."""
    centred = blocks - np.median(blocks, axis=1, keepdims=True)
    steps = np.sqrt(((centred[1:] - centred[:-1]) ** 2).mean(axis=1))
    reach = STUCK_NEIGHBOURHOOD
    usual = [np.median(steps[max(k - reach, 0) : k + reach + 1]) for k in range(len(steps))]
    return steps / np.maximum(usual, 1e-12)


def equal_neighbours(ratios: Float) -> NDArray[np.bool_]:
    """Which of `step_ratios` are as those of equal views, and far below the nearest that are not, on either side."""
    low = ratios < STUCK_SHARE
    others = np.flatnonzero(~low)
    sudden = np.zeros(len(ratios), bool)
    for k in np.flatnonzero(low):
        after = int(np.searchsorted(others, k))
        beside = ratios[others[max(after - 1, 0) : after + 1]]
        sudden[k] = len(beside) > 0 and ratios[k] < MAX_SUDDEN_SHARE * beside.min()
    return sudden
