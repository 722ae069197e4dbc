"""Labels of any type of whole numbers, read slab by slab."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.model.label_sums import label_sizes
from grainmotion.model.large_arrays import large_zeros
from grainmotion.segmentation.labels import MAX_LABEL

MAX_NEGATIVE_LABELS = 1
"""Different negative numbers that may stand for no grain."""
USUAL_NEGATIVE = -1
"""The negative number that programs write for no grain, or for lines between grains."""
MAX_GRAIN_RATIO = 3
"""Voxels of 0 over those of the largest grain up to which 0 is taken for a grain, where another number is around."""


def label_array(file: VolumeFile, where: str) -> tuple[NDArray[np.int32], int]:
    """Labels, 0 for no grain, and the negative number that stood for no grain in the file, 0 if there was none.

    One negative number is taken for no grain.  Refused are several, as labels that ran over the top of their type; one
    other than -1 that is rarer than 0, for the same reason; and one beside which 0 is no more frequent than a grain.
    """
    labels, negative, below, zeros = large_zeros(file.shape, np.int32), set[int](), 0, 0
    for (first, last), slab in zip(file.bounds, file.slabs(file.bounds), strict=True):
        _check_whole(slab, where)
        if float(slab.max(initial=0)) > MAX_LABEL:
            remedy = f"number the grains up to {MAX_LABEL}, as skimage.segmentation.relabel_sequential(labels)[0] does"
            raise InputError(where, f"a label of {int(slab.max())}", remedy)
        if slab.dtype.kind not in "ub":
            under = slab < 0
            negative |= {int(value) for value in np.unique(slab[under])[: MAX_NEGATIVE_LABELS + 1]}
            below += int(np.count_nonzero(under))
            zeros += int(np.count_nonzero(slab == 0))
            slab = np.maximum(slab, 0)
        labels[first:last] = slab
    if negative:
        _check_negative(negative, below, zeros, labels, file.dtype, where)
    if not labels.any():
        raise InputError(where, "no grains found: no label is above 0", "give 1, 2, ... where grains are")
    return labels, min(negative, default=0)


def _check_whole(slab: Pixels, where: str) -> None:
    """Refuse grey values, probabilities and NaN."""
    if slab.dtype.kind != "f":
        return
    if np.isnan(slab).any():
        fact = f"{np.isnan(slab).mean():.0%} of its voxels are NaN, not whole numbers"
        raise InputError(where, fact, "give 0 for no grain: numpy.nan_to_num(labels).astype(int)")
    if not (np.isfinite(slab).all() and (slab == np.round(slab)).all()):
        fact = f"its numbers, {slab.dtype}, are not whole numbers: grey values or a probability"
        raise InputError(where, fact, "give 0 for no grain, 1, 2, ... for grains, without interpolation")


def _check_negative(
    negative: set[int], below: int, zeros: int, labels: NDArray[np.int32], dtype: np.dtype, where: str
) -> None:
    """Refuse negative numbers that are grains, or beside which 0 is one."""
    one, unsigned = min(negative), "export them as unsigned whole numbers of 32 bits"
    if len(negative) > MAX_NEGATIVE_LABELS:
        fact = f"labels below 0, from {one} to {max(negative)}: probably they ran over the top of {dtype}"
        raise InputError(where, fact, unsigned)
    if one != USUAL_NEGATIVE and below < zeros:
        fact = f"label {one} beside 0 for no grain: probably a label that ran over the top of {dtype}"
        raise InputError(where, fact, f"{unsigned}; if no grain is there, give 0")
    if 0 < zeros < below and zeros <= MAX_GRAIN_RATIO * int(label_sizes(labels)[1:].max(initial=0)):
        fact = f"{one} is around the grains, and 0 holds {zeros} voxels, as a grain does: probably grains begin at 0"
        raise InputError(where, fact, "give labels + 1, so that 0 is no grain")
