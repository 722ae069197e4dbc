"""Sizes of what workers hold: without them Dask takes nouns for nothing, and neither spills nor places them well."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from grainmotion.cluster.pieces import Some, Stripe, Walked
from grainmotion.cluster.slabs import Kept
from grainmotion.geometry import Geometry
from grainmotion.operators import VolumeOperator
from grainmotion.reconstructing.equations import Imaging
from grainmotion.reconstructing.slabs import Seen, Slab, Strip
from grainmotion.scan import Scan
from grainmotion.volume import Volume

NOUNS = (Geometry, Imaging, Kept, Scan, Seen, Slab, Some, Strip, Stripe, Volume, VolumeOperator, Walked)


def register() -> None:
    """Tell Dask in this process."""
    from dask.sizeof import sizeof

    def size(noun: Any) -> int:
        return sum(int(sizeof(getattr(noun, field.name))) for field in fields(noun))

    for kind in NOUNS:
        sizeof.register(kind, size)
