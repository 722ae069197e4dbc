"""Ready: what every worker is told before its first task, also one that joins late."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from grainmotion.cluster.sizes import register
from grainmotion.cluster.threads import settle

if TYPE_CHECKING:
    from distributed import Client


def make_ready(client: Client) -> None:
    """Tell workers how large nouns are, and how many threads kernels have."""
    from distributed import WorkerPlugin

    class Ready(WorkerPlugin):
        name = "grainmotion-ready"

        def setup(self, worker: Any) -> None:
            register()
            settle(worker.state.nthreads)

    client.register_plugin(Ready())
