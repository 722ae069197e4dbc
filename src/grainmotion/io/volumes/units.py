"""Units of length as other programs write them, and the edges of a voxel that a file tells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

CUBE_TOLERANCE = 2e-3
"""Relative difference of a voxel's edges up to which it is a cube: half a voxel over 250, about what segmentation and
fits leave, and more than what programs round."""
_NAMES: Mapping[str, float] = MappingProxyType({
    name: factor
    for names, factor in (
        ("nm nanometer nanometre nanometers nanometres", 1e-6),
        ("å angstrom angström", 1e-7),
        ("µm um micron microns micrometer micrometre micrometers micrometres µ", 1e-3),
        ("mm millimeter millimetre millimeters millimetres", 1.0),
        ("cm centimeter centimetre centimeters centimetres", 10.0),
        ("m meter metre meters metres", 1e3),
        ('in inch inches "', 25.4),
    )
    for name in names.split()
})  # fmt: skip


def unit_in_mm(unit: str | None) -> float | None:
    """Millimetres in a unit of length; None for pixels, for no unit, and for an unknown one."""
    if unit is None:
        return None
    text = unit.strip().strip("'\"") or unit.strip()
    text = text.replace("\\u00b5", "µ").replace("\\u00B5", "µ").replace("μ", "µ").replace("Âµ", "µ")
    return _NAMES.get(text.lower())


@dataclass(frozen=True)
class ToldVoxel:
    """The edges of a voxel along x, y, z, mm, and where the file tells them."""

    edges: tuple[float, float, float]
    key: str

    @property
    def size(self) -> float | None:
        """The edge of a cube, mm; None if the voxels are no cubes."""
        return self.edges[0] if max(self.edges) <= min(self.edges) * (1 + CUBE_TOLERANCE) else None

    @property
    def text(self) -> str:
        """The edges in words."""
        if self.size is not None:
            return f"{self.size:.6g} mm"
        return " x ".join(f"{edge:.6g}" for edge in self.edges) + " mm (x y z)"


def told_voxel(
    numbers: Sequence[float], unit: str | None, key: str, *, one_is_default: bool = False
) -> tuple[ToldVoxel | None, tuple[str, ...]]:
    """The voxel that a header tells by three ``numbers`` x y z, and notes about why it is not used.

    Not used are sizes that are not positive, without a unit of length, or 1 where programs write 1 if they know none.
    """
    values = [abs(float(number)) for number in numbers]
    if len(values) != 3 or not all(math.isfinite(value) and value > 0 for value in values):
        return None, ()
    shown = " x ".join(f"{value:.6g}" for value in dict.fromkeys(values))
    if one_is_default and values == [1.0, 1.0, 1.0]:
        return None, (f"{key} is 1, as programs write it where they know no voxel size",)
    factor = unit_in_mm(unit)
    if factor is None:
        known = unit is None or unit.strip().lower() in ("", "none", "unknown")
        of = "without a unit" if known else f"in '{(unit or '').strip()}', which is no unit of length"
        return None, (f"{key} tells voxels of {shown} {of}",)
    x, y, z = (value * factor for value in values)
    return ToldVoxel((x, y, z), key), ()
