"""What OME-Zarr 0.4 and 0.5 tell of an image in the attributes of its group: axes, units, levels and their scales."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from grainmotion.io.volumes.units import ToldVoxel, told_voxel

OWN_KEY = "grainmotion"
"""Attribute by which this package's files tell the centre of the array."""
_FIRST_AXES = ("t", "c", "z", "y", "x")  # of OME-Zarr 0.1 and 0.2, which do not name them
Attributes = Mapping[str, object]


@dataclass(frozen=True)
class OmeImage:
    """An image of several levels, the finest first."""

    axes: tuple[str, ...]
    units: tuple[str | None, ...]
    paths: tuple[str, ...]  # of the levels' arrays, within the group
    scales: tuple[tuple[float, ...], ...]  # of each level, along all axes

    @classmethod
    def of(cls, attributes: Attributes) -> OmeImage | None:
        """The first image of a group; None if the attributes describe none."""
        ome = attributes.get("ome")
        told = (ome if isinstance(ome, Mapping) else attributes).get("multiscales")
        image = told[0] if isinstance(told, Sequence) and told else None
        levels = image.get("datasets") if isinstance(image, Mapping) else None
        if not isinstance(image, Mapping) or not isinstance(levels, Sequence) or not levels:
            return None
        axes, units = _axes(image.get("axes"))
        common = _scale(image, len(axes))
        scales = [tuple(a * b for a, b in zip(_scale(level, len(axes)), common)) for level in levels]
        return cls(axes, units, tuple(str(level.get("path", "")) for level in levels), tuple(scales))

    def voxel(self, level: str, order: tuple[int, int, int]) -> tuple[ToldVoxel | None, tuple[str, ...]]:
        """The voxel of a level whose axes ``order`` are z, y, x."""
        scale = self.scales[self.paths.index(level)]
        units = {self.units[k] for k in order}
        unit = units.pop() if len(units) == 1 else None
        return told_voxel([scale[k] for k in order[::-1]], unit, "axes' scales", one_is_default=True)


def told_center(attributes: Attributes) -> tuple[float, float, float] | None:
    """The centre of the array, in stores of this package."""
    own = attributes.get(OWN_KEY)
    center = own.get("center") if isinstance(own, Mapping) else None
    if not isinstance(center, Sequence) or len(center) != 3:
        return None
    return float(center[0]), float(center[1]), float(center[2])


def _axes(told: object) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    if not isinstance(told, Sequence) or not told:
        return _FIRST_AXES, (None,) * len(_FIRST_AXES)
    names = tuple(str(axis.get("name", "")) if isinstance(axis, Mapping) else str(axis) for axis in told)
    units = [axis.get("unit") if isinstance(axis, Mapping) else None for axis in told]
    return names, tuple(unit if isinstance(unit, str) else None for unit in units)


def _scale(holder: object, axes: int) -> tuple[float, ...]:
    """The product of the scales in ``coordinateTransformations``."""
    size = [1.0] * axes
    transforms = holder.get("coordinateTransformations") if isinstance(holder, Mapping) else None
    for transform in transforms if isinstance(transforms, Sequence) else ():
        scale = transform.get("scale") if isinstance(transform, Mapping) else None
        if isinstance(scale, Sequence) and len(scale) == axes:
            size = [a * float(b) for a, b in zip(size, scale)]
    return tuple(size)
