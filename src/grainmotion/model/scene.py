"""Scene: everything that attenuates beside the grains, in parts that may move each in its own ways.

The attenuation of a state is the sum of its grains, which are free, of bodies (pistons, a container's wall), of a
fluid between them, and of what the field of view of the reference scan did not hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.fluid import Fluid
from grainmotion.model.hardening import LINEAR, Hardening
from grainmotion.model.summary import Summarised, Summary
from grainmotion.model.symmetry import symmetry_axis
from grainmotion.model.volume import Volume

Kind = Literal["piston", "wall", "rest", "body"]
"""What a body is by its place: a sheet above or below the grains, around them, scattered, or anything else."""
WAYS = ("x", "y", "z", "wx", "wy", "wz")
"""Ways in which a body may move: along an axis, and about an axis through its centre."""
SAME_VOXELS = 1e-3
"""Voxels by which the grids of two volumes may differ and count as one."""


@dataclass(frozen=True)
class Freedom:
    """The ways in which a body may move.

    Attributes
    ----------
    ways : tuple of 6 numbers each
        Allowed motions (ux, uy, uz, ωx, ωy, ωz), mm and radians about the body's centre; none: it is fixed.

    Raises
    ------
    InputError
        If a way does not have 6 finite numbers, or one follows from the others.

    Examples
    --------
    >>> gm.Freedom.of("z wz").basis.shape
    (6, 2)
    >>> gm.Freedom.of("fixed").moves
    False
    """

    ways: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        basis = self.basis
        if self.ways and not (np.isfinite(basis).all() and np.linalg.matrix_rank(basis) == len(self.ways)):
            raise InputError("freedom", f"{self.ways} are no independent motions", f'give "fixed", "free" or {WAYS}')

    @classmethod
    def of(cls, text: str) -> Freedom:
        """From a text.

        Parameters
        ----------
        text : str
            "fixed", "free" (in all six ways), some of "x y z wx wy wz" with spaces between them (along an axis, about
            an axis), or "along a b c" with the direction of one axis.

        Returns
        -------
        Freedom

        Raises
        ------
        InputError
            If it is none of these.
        """
        words = text.split()
        if text in ("fixed", "free"):
            words = list(WAYS) if text == "free" else []
        elif words and words[0] == "along" and len(words) == 4:
            try:
                direction = np.array([float(word) for word in words[1:]])
            except ValueError:
                direction = np.zeros(3)
            length = float(np.linalg.norm(direction))
            if np.isfinite(length) and length > 0:
                return cls(((*(float(d) for d in direction / length), 0.0, 0.0, 0.0),))
        if (text not in ("fixed", "free") and not words) or not set(words) <= set(WAYS):
            raise InputError("freedom", f"{text!r} is unknown", f'give "fixed", "free", some of {" ".join(WAYS)}')
        return cls(tuple(tuple(row) for row in np.eye(6)[[k for k, way in enumerate(WAYS) if way in words]].tolist()))

    @property
    def basis(self) -> NDArray[np.float64]:
        """The allowed motions as columns ``(6, k)``."""
        if any(len(way) != len(WAYS) for way in self.ways):
            raise InputError("freedom", f"{self.ways} are not of 6 numbers each", f'give "fixed", "free" or {WAYS}')
        return np.array(self.ways, dtype=float).reshape(-1, len(WAYS)).T

    @property
    def moves(self) -> bool:
        """Whether it allows any motion."""
        return bool(self.ways)

    def without_rotation_about(self, axis: NDArray[np.float64]) -> Freedom:
        """What is left of it if the body does not rotate about an axis.

        Parameters
        ----------
        axis : (3,) array
            Its direction.

        Returns
        -------
        Freedom
            Its motions with ω · axis = 0.
        """
        amounts = self.basis[3:].T @ axis
        if np.abs(amounts).max(initial=0.0) < 1e-9:
            return self
        others = np.linalg.svd(amounts[None])[2][1:].T
        return Freedom(tuple(tuple(way) for way in (self.basis @ others).T.tolist()))

    @property
    def text(self) -> str:
        """As `of` takes it."""
        for text in ("fixed", "free"):
            if self == Freedom.of(text):
                return text
        units = np.eye(len(WAYS)).tolist()
        if all(list(way) in units for way in self.ways):
            return " ".join(WAYS[units.index(list(way))] for way in self.ways)
        return "along " + " ".join(f"{value:.9g}" for value in self.ways[0][:3])


NO_MOTION, RIGID_MOTION = Freedom(), Freedom.of("free")
"""No motion, and any motion of a rigid body."""


@dataclass(frozen=True, eq=False, repr=False)
class Body(Summarised):
    """A body beside the grains, such as a piston or a container's wall.

    Attributes
    ----------
    name : str
        Such as "upper piston", "wall", "rest"; its own in a scene.
    kind : {"piston", "wall", "rest", "body"}
        What it is by its place.
    volume : Volume
        Its own attenuation, 1/mm, in its place; cropped as a rule.
    freedom : Freedom
        The ways in which it may move.

    Examples
    --------
    A piston that moves along z only:

    >>> disc = gm.Volume(np.ones((4, 20, 20)), voxel_size=0.1, center=(0, 0, 3.0))
    >>> piston = gm.Body("upper piston", "piston", disc, gm.Freedom.of("z"))
    >>> piston.center.round(6).tolist()
    [0.0, 0.0, 3.0]
    """

    name: str
    kind: Kind
    volume: Volume
    freedom: Freedom = RIGID_MOTION

    @cached_property
    def center(self) -> NDArray[np.float64]:
        """Attenuation-weighted centre of mass ``(3,)``, mm, x y z: the centre of its rotations."""
        array = self.volume.array
        marginals = [array.sum(axis=tuple({0, 1, 2} - {2 - k}), dtype=float) for k in range(3)]
        if marginals[0].sum() <= 0:
            return np.array(self.volume.center)
        voxels = [float(m @ np.arange(len(m)) / m.sum()) for m in marginals]
        return np.asarray(self.volume.origin + self.volume.voxel_size * np.array(voxels))

    @cached_property
    def symmetry_axis(self) -> NDArray[np.float64] | None:
        """Axis ``(3,)`` about which it looks the same however it is turned, as a disc or a tube; None without one."""
        return symmetry_axis(self.volume)


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Summarised):
    """Everything that attenuates beside the grains.

    Attributes
    ----------
    bodies : tuple of Body
        On voxels of one grid.
    fluid : Fluid, optional
        The liquid between them: grains hold their excess over it.
    field : FieldOfView, optional
        What the reference scan saw of the sample; None if that is not known.
    hardening : Hardening
        Curve by which the reference scan was linearised; `track` applies it to the radiographs of each state.

    Raises
    ------
    InputError
        If two bodies have one name, or their voxels are not of one grid.

    Examples
    --------
    >>> grains.scene.bodies, grains.scene.fluid
    ((), None)
    """

    bodies: tuple[Body, ...] = ()
    fluid: Fluid | None = None
    field: FieldOfView | None = None
    hardening: Hardening = LINEAR

    def __post_init__(self) -> None:
        names = [body.name for body in self.bodies]
        if len(set(names)) < len(names):
            raise InputError("scene.bodies", f"names {names}", "give each body a name of its own")
        for body in self.bodies:
            first_voxel(body.volume, self.bodies[0].volume)

    @property
    def moves(self) -> bool:
        """Whether any body may move."""
        return any(body.freedom.moves for body in self.bodies)

    @cached_property
    def volume(self) -> Volume | None:
        """Bodies and fluid of the reference together, as if no grain were in the fluid; None without either."""
        parts = [self.bodies_volume, None if self.fluid is None else self.fluid.volume]
        return _sum([part for part in parts if part is not None])

    @cached_property
    def bodies_volume(self) -> Volume | None:
        """The sum of all bodies on the smallest grid that holds them; None without bodies."""
        return _sum([body.volume for body in self.bodies])

    def _summary(self) -> Summary:
        bodies = ", ".join(f"{body.name} ({body.freedom.text})" for body in self.bodies) or "none"
        rows = [("bodies", bodies), ("fluid", "none" if self.fluid is None else f"{self.fluid.attenuation:.4g} 1/mm")]
        if self.field is not None:
            rows.append(("field of view", "holds the whole sample" if self.field.holds_all else "cuts the sample"))
        return Summary("Scene", ", ".join(f"{name}: {value}" for name, value in rows), tuple(rows))


def _sum(volumes: list[Volume]) -> Volume | None:
    """The sum of some volumes on the smallest grid that holds them; None without any."""
    if len(volumes) < 2:
        return volumes[0] if volumes else None
    starts = [np.array(first_voxel(volume, volumes[0])) for volume in volumes]
    low = np.min(starts, axis=0)
    high = np.max([s + v.shape for s, v in zip(starts, volumes, strict=True)], axis=0)
    array = np.zeros(high - low, np.result_type(*(volume.array.dtype for volume in volumes)))
    for start, volume in zip(starts, volumes, strict=True):
        array[tuple(slice(a, a + n) for a, n in zip(start - low, volume.shape, strict=True))] += volume.array
    h = volumes[0].voxel_size
    x, y, z = (float(c) for c in volumes[0].origin + h * (low + (np.array(array.shape) - 1) / 2)[::-1])
    return Volume(array, h, (x, y, z))


def first_voxel(part: Volume, whole: Volume) -> tuple[int, ...]:
    """Index (z, y, x) of the first voxel of a volume in the grid of another.

    Raises
    ------
    InputError
        If their voxels do not lie on one grid.
    """
    steps = ((part.origin - whole.origin) / whole.voxel_size)[::-1]
    off = float(np.abs(steps - np.round(steps)).max())
    if off > SAME_VOXELS or abs(part.voxel_size / whole.voxel_size - 1) * max(part.shape) > SAME_VOXELS:
        fact = f"voxels of {part.voxel_size} and {whole.voxel_size} mm, {off:.3g} of one apart"
        raise InputError("scene.bodies", fact, "cut them from one volume")
    return tuple(int(step) for step in np.round(steps))
