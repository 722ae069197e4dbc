"""Grain, GrainSet: the grains of the reference state, each with its own voxels."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.scene import Scene
from grainmotion.model.summary import Summarised, Summary, names_text, shape_text, vector_text
from grainmotion.model.thumbnails import LINE, circles_picture, grey_picture
from grainmotion.model.volume import Volume


@dataclass(frozen=True, eq=False, repr=False)
class Grain(Summarised):
    """One grain in the reference state.

    Attributes
    ----------
    label : int
        Its label in the reference volume.
    volume : Volume or CompactVolume
        Its own attenuation, cropped, zero in the outermost `PADDING` voxels.  Those of many grains are kept
        compactly, and their ``array`` is made anew each time.
    center : (3,) array
        Attenuation-weighted centre of mass c, mm, x y z: the centre of its rotations.
    touches_border : bool
        Whether it reaches the border of the reconstructed field of view, and so may be incomplete.
    fine : Volume or CompactVolume, optional
        The same attenuation on finer voxels, for the last stages of tracking; padded and kept as ``volume``.

    Examples
    --------
    >>> grain = grains.grains[0]
    >>> grain.label, grain.center.shape, grain.touches_border
    (1, (3,), False)
    """

    label: int
    volume: Volume | CompactVolume
    center: NDArray[np.float64]
    touches_border: bool = False
    fine: Volume | CompactVolume | None = None

    @property
    def coarse_volume(self) -> Volume:
        """``volume`` with all its voxels in memory."""
        return self.volume.volume if isinstance(self.volume, CompactVolume) else self.volume

    @property
    def fine_volume(self) -> Volume | None:
        """``fine`` with all its voxels in memory."""
        return self.fine.volume if isinstance(self.fine, CompactVolume) else self.fine

    def _summary(self) -> Summary:
        box = f"{shape_text(self.volume.shape)} voxels of {self.volume.voxel_size:.5g} mm"
        rows = [("centre", f"{vector_text(self.center)} mm"), ("voxels (z, y, x)", box)]
        rows += [] if self.fine is None else [("finer voxels", f"{shape_text(self.fine.shape)}")]
        rows += [("at the border", "yes: it may be incomplete")] if self.touches_border else []
        middle = self.volume.array[:, self.volume.shape[1] // 2]
        return Summary(
            f"Grain {self.label}", f"centre {rows[0][1]}, {box}", tuple(rows), grey_picture(middle, upwards=True)
        )


@dataclass(frozen=True, eq=False, repr=False)
class GrainSet(Summarised):
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

    Examples
    --------
    >>> len(grains), grains.labels.tolist(), grains.voxel_size
    (4, [1, 2, 3, 4], 0.125)
    >>> len(grains.without([2]))
    3
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

    def __iter__(self) -> Iterator[Grain]:
        return iter(self.grains)

    def __contains__(self, label: object) -> bool:
        return any(grain.label == label for grain in self.grains)

    @overload
    def __getitem__(self, label: int) -> Grain: ...

    @overload
    def __getitem__(self, label: Sequence[int] | NDArray[np.integer]) -> GrainSet: ...

    def __getitem__(self, label: int | Sequence[int] | NDArray[np.integer]) -> Grain | GrainSet:
        """The grain of a label, or a set of the grains of several labels, in their order and in the same scene."""
        by_label = {grain.label: grain for grain in self.grains}
        wanted = [int(label)] if isinstance(label, int | np.integer) else [int(one) for one in label]
        for one in wanted:
            if one not in by_label:
                raise InputError("grains", f"there is no grain {one}", "give one of grains.labels")
        if isinstance(label, int | np.integer):
            return by_label[wanted[0]]
        return replace(self, grains=tuple(by_label[one] for one in wanted))

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
        gone = set(rows)
        return replace(self, grains=tuple(g for k, g in enumerate(self.grains) if k not in gone))

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
        return np.result_type(*{g.volume.dtype for g in self.grains})

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel, mm."""
        return self.grains[0].volume.voxel_size

    def _summary(self) -> Summary:
        names = names_text([str(grain.label) for grain in self.grains])
        cut, scene = int(self.cut.sum()), self.scene
        rows = [("labels", names), ("voxel", f"{self.voxel_size:.5g} mm")]
        rows += [("cut by the field of view", str(cut))] if cut else []
        rows += [("beside them", ", ".join(body.name for body in scene.bodies))] if scene.bodies else []
        rows += [("fluid", f"{scene.fluid.attenuation:.4g} 1/mm")] if scene.fluid is not None else []
        radii = np.array([sum(grain.volume.shape) for grain in self.grains]) * self.voxel_size / 6
        picture = circles_picture(self.centers[:, [0, 2]], 0.75 * radii, [LINE] * len(self))
        return Summary(f"GrainSet of {len(self)} grains", f"voxel {self.voxel_size:.5g} mm", tuple(rows), picture)
