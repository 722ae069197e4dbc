"""Sizes of what workers hold: without them Dask takes nouns for nothing, and neither spills nor places them well."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from grainmotion.cluster.pieces import Some, Stripe, Walked
from grainmotion.cluster.slabs import Kept
from grainmotion.geometry import Geometry
from grainmotion.operators import VolumeOperator
from grainmotion.reconstructing.equations import Imaging
from grainmotion.reconstructing.slabs import Seen, Slab, Strip
from grainmotion.scan import Scan
from grainmotion.volume import Volume

if TYPE_CHECKING:
    from distributed import Client

NOUNS = (Geometry, Imaging, Kept, Scan, Seen, Slab, Some, Strip, Stripe, Volume, VolumeOperator, Walked)


def tell_sizes(client: Client) -> None:
    """Tell every worker, also one that joins late, how large nouns are."""
    from distributed import WorkerPlugin

    class Sizes(WorkerPlugin):
        name = "grainmotion-sizes"

        def setup(self, worker: Any) -> None:
            register()

    client.register_plugin(Sizes())


def register() -> None:
    """Tell Dask in this process."""
    from dask.sizeof import sizeof

    def size(noun: Any) -> int:
        return sum(int(sizeof(getattr(noun, field.name))) for field in fields(noun))

    for kind in NOUNS:
        sizeof.register(kind, size)
