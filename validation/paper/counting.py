"""What solvers take: projections of grains counted and timed, and our tracker's run under that count."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from unittest import mock

from grainmotion.kernels import grain_projection as kernel
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.tracking.track import TrackSettings, track


@dataclass
class Count:
    """Projections of a grain to a view, and the CPU seconds that they took."""

    projections: int = 0
    cpu: float = 0.0


@contextmanager
def counted() -> Iterator[Count]:
    """Count projections while it lasts: one a grain and view, with derivatives or without."""
    count = Count()

    def counting(inner: Callable[..., None]) -> Callable[..., None]:
        def counted_projection(*arguments: object) -> None:
            begin = time.process_time()
            inner(*arguments)
            count.cpu += time.process_time() - begin
            count.projections += len(arguments[2].boxes)  # one a grain and view

        return counted_projection

    kernels = {name: counting(getattr(kernel, name)) for name in ("project", "project_with_derivatives")}
    with mock.patch.multiple(kernel, **kernels):
        yield count


@dataclass(frozen=True, eq=False)
class Took:
    """What our tracker measured, and what it took."""

    motions: Motions
    iterations: int
    cpu: float
    count: Count


def ours(grains: GrainSet, scan: Scan, settings: TrackSettings, start: Motions | None = None) -> Took:
    """Track, counting accepted steps of all stages and searches."""
    messages: list[str] = []
    with counted() as count:
        begin = time.process_time()
        motions = track(grains, scan, start, settings, progress=lambda message, *_: messages.append(message))
        cpu = time.process_time() - begin
    return Took(motions, sum(": residual" in message for message in messages), cpu, count)
