"""Parts of a reference volume: which share of its attenuation grains, bodies and a liquid hold."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.model.label_sums import label_sizes, label_sums
from grainmotion.model.scene import Scene, first_voxel
from grainmotion.model.volume import Volume

NO_PART = "no part"


@dataclass(frozen=True)
class ScenePart:
    """What holds some of a volume's attenuation.

    Attributes
    ----------
    name : str
        "grains", a body's name, "liquid", or "no part".
    share : float
        Of the sum of the volume's attenuation.
    detail : str
        What else is known: a number of grains, in which ways a body may move, a liquid's attenuation and level.
    """

    name: str
    share: float
    detail: str = ""

    def __str__(self) -> str:
        detail = f", {self.detail}" if self.detail else ""
        return f"{self.name} {self.share:.1%}{detail}"


def scene_parts(
    volume: Volume, labels: NDArray[np.integer], scene: Scene, border: Collection[int] = ()
) -> tuple[ScenePart, ...]:
    """What attenuates in a segmented reference, part by part; the shares add up to 1.

    A voxel counts for the grain whose label it has, else for the body that holds it, else for the liquid; "no part" is
    what is left: noise and the blurred edges of grains.

    Parameters
    ----------
    volume : Volume
        Attenuation, 1/mm.
    labels : (nz, ny, nx) integer array
        Grains, 0 for none.
    scene : Scene
        Bodies, on the volume's grid, and liquid, with a space of the volume's shape.
    border : collection of int, optional
        Labels of the grains that the border of the field of view cuts.

    Returns
    -------
    tuple of ScenePart
    """
    total = float(volume.array.sum(dtype=float))
    if total <= 0:
        return ()
    values, sizes, sums = volume.array, label_sizes(labels), label_sums(labels, volume.array)
    grains, count = float(sums[1:].sum()), np.count_nonzero(sizes[1:])
    cut = f", {len(border)} of them cut by the border of the field" if border else ""
    parts = [ScenePart("grains", grains / total, f"{count}{cut}")]
    free = labels == 0
    for body in scene.bodies:
        start = first_voxel(body.volume, volume)
        box = tuple(slice(a, a + n) for a, n in zip(start, body.volume.shape, strict=True))
        own = (body.volume.array != 0) & free[box]
        share = _sum_where(values[box], own) / total
        parts.append(ScenePart(body.name, share, f"freedom: {body.freedom.text}"))
        free[box] &= ~own
    if scene.fluid is not None:
        own = free & (scene.fluid.volume.array > 0)
        level = "up to the top of the field" if scene.fluid.level is None else f"up to z = {scene.fluid.level:.4g} mm"
        detail = f"{scene.fluid.attenuation:.4g} 1/mm {level}"
        parts.append(ScenePart("liquid", _sum_where(values, own) / total, detail))
        free &= ~own
    return *parts, ScenePart(NO_PART, _sum_where(values, free) / total, "noise and blurred edges")


def _sum_where(values: Image, mask: NDArray[np.bool_]) -> float:
    """Sum of the values where a mask is true, without a copy of them."""
    return float(sum(plane.sum(dtype=float, where=own) for plane, own in zip(values, mask, strict=True)))


def field_sentence(scene: Scene) -> str:
    """Where the sample goes on beyond what the reference scan saw; empty if it saw all, or that is not known."""
    field = scene.field
    if field is None or field.holds_all:
        return ""
    sides = {"above": field.above, "below": field.below, "beside": field.beside}
    where = " and ".join(side for side, beyond in sides.items() if beyond)
    return f"the sample goes on {where} what all views of the reference scan see"
