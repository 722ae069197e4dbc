"""Points of labels: the centroid of a label's voxels, and the middle of its bounding box."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.volume import Volume
from grainmotion.segmentation.label_measures import boxes_of_labels


@dataclass(frozen=True, eq=False)
class LabelPoints:
    """Points of the labels of a volume.

    Attributes
    ----------
    labels : (n,) int array
        The labels that have voxels, from the smallest on, without 0.
    centroids : (n, 3) array
        Centroid of each label, all its voxels with equal weight, mm, x y z.
    box_centers : (n, 3) array
        Middle of the box that bounds it, mm, x y z.
    """

    labels: NDArray[np.int64]
    centroids: Float
    box_centers: Float

    @classmethod
    def of(cls, image: NDArray[np.integer], grid: Volume) -> LabelPoints:
        """The points of a labelled image ``(nz, ny, nx)`` on the voxels of ``grid``; label by label, in its box."""
        if image.shape != grid.shape:
            raise InputError("labels", f"shape {image.shape} is not the volume's {grid.shape}", "give them on its grid")
        labels, centroids, boxes = list[int](), list[Float](), list[Float]()
        for label, box in enumerate(boxes_of_labels(image), start=1):
            if box is None:
                continue
            first = np.array([s.start for s in box], dtype=float)
            labels.append(label)
            centroids.append(first + _centroid(image[box] == label))
            boxes.append(first + (np.array([s.stop - s.start for s in box]) - 1) / 2)

        def placed(voxels: list[Float]) -> Float:
            return np.array(voxels, dtype=float).reshape(-1, 3)[:, ::-1] * grid.voxel_size + grid.origin

        return cls(np.array(labels, dtype=np.int64), placed(centroids), placed(boxes))

    def rows_of(self, labels: Collection[int] | NDArray[np.integer]) -> NDArray[np.int64]:
        """Row of each of some labels; -1 of those that have no voxels."""
        row_of = {int(label): row for row, label in enumerate(self.labels)}
        return np.array([row_of.get(int(label), -1) for label in labels], dtype=np.int64)


def _centroid(inside: NDArray[np.bool_]) -> Float:
    """Mean place of the voxels of a mask, in voxels from its corner; from counts along each axis, for large masks."""
    places = list[float]()
    for axis in range(inside.ndim):
        counts = np.count_nonzero(inside, axis=tuple(k for k in range(inside.ndim) if k != axis))
        places.append(float(np.average(np.arange(len(counts)), weights=counts)))
    return np.array(places)
