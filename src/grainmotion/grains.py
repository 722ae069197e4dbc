"""Grain, GrainSet: the grains of the reference state, each with its own voxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.volume import Volume

PADDING = 2  # empty voxels kept around each grain, so that interpolation never leaves its crop


@dataclass(frozen=True, eq=False)
class Grain:
    """One grain in the reference state.

    Attributes
    ----------
    label : int
        Its label in the reference volume.
    volume : Volume
        Its own attenuation, cropped, zero in the outermost `PADDING` voxels.
    center : (3,) array
        Attenuation-weighted centre of mass c, mm, x y z: the centre of its rotations.
    touches_border : bool
        Whether it reaches the border of the reconstructed field of view, and so may be incomplete.
    """

    label: int
    volume: Volume
    center: NDArray[np.float64]
    touches_border: bool = False


@dataclass(frozen=True, eq=False)
class GrainSet:
    """The grains of a sample, and what attenuates beside them.

    Attributes
    ----------
    grains : tuple of Grain
        All on the same voxel size.
    background : Volume, optional
        Attenuation that belongs to no grain and stays where it is (container, fines).
    """

    grains: tuple[Grain, ...]
    background: Volume | None = None

    def __len__(self) -> int:
        return len(self.grains)

    @property
    def labels(self) -> NDArray[np.int64]:
        """Labels ``(n,)``."""
        return np.array([g.label for g in self.grains], dtype=np.int64)

    @property
    def centers(self) -> NDArray[np.float64]:
        """Centres of mass ``(n, 3)``, mm, x y z."""
        return np.array([g.center for g in self.grains]).reshape(-1, 3)

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel, mm."""
        return self.grains[0].volume.voxel_size
