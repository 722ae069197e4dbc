"""The grains of the page: one row a grain, the same in every state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.label_sums import label_sizes
from grainmotion.report.data import ReportData

Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True, eq=False)
class GrainRows:
    """Labels (ascending), centres in the reference (mm) ``(n, 3)`` and diameters of balls of equal volume (mm)."""

    labels: NDArray[np.int64]
    centers: Float
    diameters: Float | None

    def of(self, labels: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows of the grains of these labels."""
        return np.searchsorted(self.labels, labels)

    def spread(self, labels: NDArray[np.int64], values: NDArray[Value], missing: float) -> NDArray[Value]:
        """The values of these grains in the page's rows, ``missing`` elsewhere."""
        whole = np.full((len(self.labels), *values.shape[1:]), missing, dtype=values.dtype)
        whole[self.of(labels)] = values
        return whole


def grain_rows(data: ReportData) -> GrainRows:
    """All grains of the states; those of the reference's labels if there is no state."""
    sizes = None if data.labels is None or data.volume is None else _sizes(data.labels)
    labels = np.unique(np.concatenate([state.motions.labels for state in data.states] or [_present(sizes)]))
    centers = np.full((len(labels), 3), np.nan)
    for state in reversed(data.states):
        centers[np.searchsorted(labels, state.motions.labels)] = state.motions.centers
    if sizes is None or data.volume is None:
        return GrainRows(labels, centers, None)
    if not data.states and data.labels is not None:
        centers = _middles(data.labels, labels, data.volume.voxel_size, data.volume.center)
    known = labels < len(sizes)
    voxels = np.where(known, sizes[np.where(known, labels, 0)], 0).astype(float)
    voxels[voxels == 0] = np.nan
    return GrainRows(labels, centers, np.cbrt(6 * voxels / np.pi) * data.volume.voxel_size)


def _present(sizes: NDArray[np.int64] | None) -> NDArray[np.int64]:
    return np.zeros(0, np.int64) if sizes is None else np.flatnonzero(sizes)


def _sizes(labels: NDArray[np.integer]) -> NDArray[np.int64]:
    """Voxels of each label, by label; 0 for what is no grain."""
    sizes = label_sizes(labels)
    sizes[0] = 0
    return sizes


def _middles(
    labels: NDArray[np.integer], wanted: NDArray[np.int64], voxel_size: float, center: tuple[float, float, float]
) -> Float:
    """Mean positions of the voxels of the wanted labels, mm, x y z."""
    top = int(wanted.max(initial=0))
    sums, count = np.zeros((top + 1, 3)), np.zeros(top + 1)
    y, x = np.indices(labels.shape[1:]).reshape(2, -1)
    for z, layer in enumerate(labels):
        flat = layer.ravel()
        inside = np.flatnonzero(flat)
        owners = flat[inside]
        for axis, position in enumerate((x[inside], y[inside], np.full(len(inside), z))):
            sums[:, axis] += np.bincount(owners, position, top + 1)
        count += np.bincount(owners, minlength=top + 1)
    middle = (np.array(labels.shape[::-1]) - 1) / 2
    return (sums[wanted] / count[wanted, None] - middle) * voxel_size + np.asarray(center)
