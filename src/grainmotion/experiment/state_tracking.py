"""One later state of an experiment file: read from its files, and tracked."""

from __future__ import annotations

from collections.abc import Callable

from grainmotion.backends.device import Device
from grainmotion.errors import InputError
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.tracking.track import TrackSettings, track


def track_state(
    source: ScanInput,
    initial: str,
    grains: GrainSet,
    start: Motions | None,
    settings: TrackSettings,
    progress: Callable[[str, int, int], None] | None = None,
    device: Device | None = None,
) -> Motions:
    """`grainmotion.tracking.track.track`, of radiographs that are read here; errors name the state.

    ``initial`` is what the experiment file says of ``start``.
    """
    radiographs, _ = source.read()
    try:
        return track(grains, radiographs, start, settings, progress=progress, device=device)
    except InputError as error:
        where = error.where.replace("start", f"initial ({initial})")
        raise InputError(f"{source.key}.{where}", error.fact, error.remedy) from error
