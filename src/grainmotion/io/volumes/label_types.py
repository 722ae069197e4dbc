"""Labels of any type of whole numbers, read slab by slab."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.segmentation.labels import MAX_LABEL

MAX_NEGATIVE_LABELS = 1
"""Different negative numbers that may stand for no grain."""


def label_array(file: VolumeFile, where: str) -> tuple[NDArray[np.int32], int]:
    """Labels, 0 for no grain, and the negative number that stood for no grain in the file, 0 if there was none.

    One negative number is taken for no grain; several are refused, as labels that ran over the top of their type.
    """
    labels, negative = np.zeros(file.shape, np.int32), set[int]()
    for (first, last), slab in zip(file.bounds, file.slabs(file.bounds), strict=True):
        if slab.dtype.kind == "f" and not (np.isfinite(slab).all() and (slab == np.round(slab)).all()):
            fact = f"its numbers, {slab.dtype}, are not whole numbers: grey values or a probability"
            raise InputError(where, fact, "give 0 for no grain, 1, 2, ... for grains, without interpolation")
        if slab.max(initial=0) > MAX_LABEL:
            remedy = f"number the grains up to {MAX_LABEL}, as skimage.segmentation.relabel_sequential(labels)[0] does"
            raise InputError(where, f"a label of {int(slab.max())}", remedy)
        if slab.dtype.kind != "u":
            negative |= {int(value) for value in np.unique(slab[slab < 0])[: MAX_NEGATIVE_LABELS + 1]}
            slab = np.maximum(slab, 0)
        labels[first:last] = slab
    if len(negative) > MAX_NEGATIVE_LABELS:
        fact = (
            f"labels below 0, from {min(negative)} to {max(negative)}: probably they ran over the top of {file.dtype}"
        )
        raise InputError(where, fact, "export them as unsigned whole numbers of 32 bits")
    if not labels.any():
        raise InputError(where, "no grains found: no label is above 0", "give 1, 2, ... where grains are")
    return labels, min(negative, default=0)
