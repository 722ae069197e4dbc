"""Grain, GrainSet: the grains of the reference state, each with its own voxels."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.scene import Scene
from grainmotion.model.volume import Volume


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
    fine : Volume, optional
        The same attenuation on finer voxels, for the last stages of tracking; padded as ``volume``.
    """

    label: int
    volume: Volume
    center: NDArray[np.float64]
    touches_border: bool = False
    fine: Volume | None = None


@dataclass(frozen=True, eq=False)
class GrainSet:
    """The grains of a sample, and everything else that attenuates.

    Attributes
    ----------
    grains : tuple of Grain
        All on the same voxel size.
    scene : Scene
        Bodies beside the grains (pistons, a container, fines), fluid, field of view.

    Raises
    ------
    InputError
        If there is no grain, two have one label, or voxel sizes differ.
    """

    grains: tuple[Grain, ...]
    scene: Scene = field(default_factory=Scene)

    def __post_init__(self) -> None:
        if not self.grains:
            raise InputError("grains", "there is no grain", "give at least one")
        labels, counts = np.unique(self.labels, return_counts=True)
        if counts.max() > 1:
            raise InputError("grains", f"label {labels[counts.argmax()]} is there twice", "give each grain its own")
        sizes = sorted({g.volume.voxel_size for g in self.grains})
        if sizes[-1] > sizes[0] * (1 + 1e-6):
            raise InputError("grains", f"voxel sizes {sizes[0]} and {sizes[-1]} mm", "extract them from one volume")

    def __len__(self) -> int:
        return len(self.grains)

    def without(self, rows: Collection[int]) -> GrainSet:
        """The same sample without some of its grains.

        Parameters
        ----------
        rows : collection of int
            Positions of those grains in ``grains``.

        Returns
        -------
        GrainSet
            The other grains, in the same scene.
        """
        return replace(self, grains=tuple(g for k, g in enumerate(self.grains) if k not in rows))

    @property
    def background(self) -> Volume | None:
        """Attenuation of all bodies of the scene, and of its fluid as in the reference; None if there is none."""
        return self.scene.volume

    @property
    def background_moves(self) -> bool:
        """Whether any body of the scene may move."""
        return self.scene.moves

    @property
    def labels(self) -> NDArray[np.int64]:
        """Labels ``(n,)``."""
        return np.array([g.label for g in self.grains], dtype=np.int64)

    @property
    def centers(self) -> NDArray[np.float64]:
        """Centres of mass ``(n, 3)``, mm, x y z."""
        return np.array([g.center for g in self.grains]).reshape(-1, 3)

    @property
    def cut(self) -> NDArray[np.bool_]:
        """Grains that the reference scan saw only in part ``(n,)``; none where it is not known what it saw."""
        known = self.scene.field is not None
        return np.array([known and g.touches_border for g in self.grains], dtype=bool)

    @property
    def precision(self) -> np.dtype[np.floating]:
        """The precision of the grains' voxels, and so of all work on them."""
        return np.result_type(*(g.volume.array.dtype for g in self.grains))

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel, mm."""
        return self.grains[0].volume.voxel_size
