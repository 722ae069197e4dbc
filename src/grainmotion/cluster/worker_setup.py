"""Worker setup: a plugin that tells each worker its threads and the sizes of our records.

Without the sizes Dask takes records for nothing, and neither spills nor places them well.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from grainmotion.cluster.reconstruction_tasks import SlabState
from grainmotion.cluster.tracking_tasks import ImageStrip, ProjectedPatches, Rays
from grainmotion.cluster.worker_threads import settle
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator
from grainmotion.reconstruction.slabs import RadiographRows, Slab, Strip
from grainmotion.reconstruction.system import Imaging

if TYPE_CHECKING:
    from distributed import Client

NOUNS = (
    Geometry,
    Imaging,
    SlabState,
    Scan,
    RadiographRows,
    Slab,
    Rays,
    Strip,
    ImageStrip,
    Volume,
    VolumeOperator,
    ProjectedPatches,
)


def register() -> None:
    """Tell Dask in this process."""
    from dask.sizeof import sizeof

    def size(noun: Any) -> int:
        return sum(int(sizeof(getattr(noun, field.name))) for field in fields(noun))

    for kind in NOUNS:
        sizeof.register(kind, size)


def make_ready(client: Client) -> None:
    """Tell workers how large nouns are, and how many threads kernels have."""
    from distributed import WorkerPlugin

    class Ready(WorkerPlugin):
        name = "grainmotion-ready"

        def setup(self, worker: Any) -> None:
            register()
            settle(worker.state.nthreads)

    client.register_plugin(Ready())
