"""Pieces of a grain that became labels of their own: tips, and what noise cuts off."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion.segmentation.label_pairs import LabelPairs

T = TypeVar("T", bound=np.generic)
Ints = NDArray[np.int32]

TIP = 0.05
"""Volume of a tip over that of a typical grain, at most."""
TIP_CONTACT = 0.08
"""Share of a tip's surface in its neck, at least."""
BROAD_CONTACT = 0.18
"""The same for a larger piece of a grain: 0.2 to 0.4, up to 0.13 in grains that touch."""
NECK_LEVEL = (1.06, 1.45)
"""Attenuation of the middle of the neck over the mean of the piece: 1.07 to 1.4, up to 1.03 in small grains that touch;
more where grains cut by the border of the volume meet, which is too bright there.
"""


def without_fragments(pairs: LabelPairs, sizes: NDArray[np.int64], sums: NDArray[np.float64]) -> Ints:
    """New labels in which pieces that a neck of full attenuation joins to a neighbour belong to that neighbour.

    Blur leaves a valley between two grains that touch, so their neck is fainter than they are, and it takes a small
    part of their surface.  A piece of a grain has a broad neck, a thin tip at least one as dense as itself.

    Parameters
    ----------
    pairs : LabelPairs
        Labels that touch, and the attenuation of their necks.
    sizes, sums : (n + 1,) arrays
        Voxels of each label, and the sum of their attenuation.

    Returns
    -------
    (n + 1,) int32 array
        Of each label the one that it belongs to.
    """
    new = np.arange(len(sizes), dtype=np.int32)
    while True:
        hosts = _hosts(pairs, sizes, sums)
        if (hosts == np.arange(len(hosts))).all():
            return new
        new = hosts[new]
        pairs = pairs.renumbered(hosts)
        sizes, sums = added_up(hosts, sizes), added_up(hosts, sums)


def added_up(new: NDArray[np.integer], values: NDArray[T]) -> NDArray[T]:
    """Sums ``(n + 1,)`` of the values of labels that become one of n others."""
    return np.bincount(new, values, minlength=int(new.max(initial=0)) + 1).astype(values.dtype)


def _hosts(pairs: LabelPairs, sizes: NDArray[np.int64], sums: NDArray[np.float64]) -> Ints:
    """Of each label itself, or the neighbour of which it is a fragment."""
    sizes = sizes.copy()
    sizes[0] = 0
    new = np.arange(len(sizes), dtype=np.int32)
    present = np.sort(sizes[sizes > 0])
    if len(present) < 2:
        return new
    weights = np.cumsum(np.sqrt(present))
    tip = TIP * present[np.searchsorted(weights, weights[-1] / 2)]
    means = sums / np.maximum(sizes, 1)
    low, high = NECK_LEVEL
    for label, (host, share, dense) in _necks(pairs).items():
        least = TIP_CONTACT if sizes[label] < tip else BROAD_CONTACT
        smaller = (sizes[label], label) < (sizes[host], host)  # a total order: no chain leads back
        if smaller and share > least and low < dense / means[label] < high:
            new[label] = host
    for label in np.argsort(-sizes, kind="stable"):  # hosts that are fragments themselves
        new[label] = new[new[label]]
    return new


def _necks(pairs: LabelPairs) -> dict[int, tuple[int, float, float]]:
    """Of each label the neighbour of the broadest neck, its share of the label's surface and its attenuation."""
    labels, hosts = np.concatenate([pairs.pairs, pairs.pairs[:, ::-1]]).T
    count, dense = (np.concatenate([v, v]) for v in (pairs.faces.sum(axis=1), pairs.tops.mean(axis=1)))
    found = dict[int, tuple[int, float, float]]()
    order = np.lexsort((hosts, labels))  # of necks as broad the last
    for k in order[np.argsort(count[order], kind="stable")]:  # the broadest last
        if np.isfinite(dense[k]):  # as many faces as the middle of a neck has
            label = int(labels[k])
            found[label] = (int(hosts[k]), float(count[k] / pairs.surface[label]), float(dense[k]))
    return found
