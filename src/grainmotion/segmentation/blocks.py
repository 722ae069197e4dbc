"""Work on a volume block by block, by all threads, with progress; no result depends on the blocks or on the threads.

Filters of finite reach get a block with as many voxels more on each side (`Block.gather`).  Counts are whole numbers,
one set a thread, which are added up in the end (`Work.gathered`).
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Progress
from grainmotion.kernels.block_filters import gather_block

EDGES = (64, 64, 256)
"""Voxels of a block along z, y, x; a block and its surroundings stay in the cache of a core."""
SLAB_VOXELS = 1 << 22
"""Voxels of the planes that are worked on together."""
PERCENT = 100
"""Steps of progress."""
TELL_SECONDS = 0.2
"""Seconds between two calls of progress."""

Item = TypeVar("Item")
Result = TypeVar("Result")
Box = tuple[slice, slice, slice]


@dataclass(frozen=True)
class Block:
    """Voxels from ``start`` up to ``stop`` along z, y, x."""

    start: tuple[int, int, int]
    stop: tuple[int, int, int]

    @property
    def box(self) -> Box:
        """The block as an index."""
        z, y, x = (slice(a, b) for a, b in zip(self.start, self.stop, strict=True))
        return z, y, x

    @property
    def limits(self) -> NDArray[np.int64]:
        """First and last (excluded) voxel along z, y, x ``(6,)``."""
        return np.array([self.start, self.stop], np.int64).T.ravel()

    def gather(self, array: NDArray, reach: int, beyond: float | None = None, kind: type = np.float32) -> NDArray:
        """The block with voxels around it; beyond the array its mirror image, or a given value."""
        z, y, x = (_places(a - reach, b + reach, n, beyond is None) for a, b, n in self._sides(array.shape))
        out: NDArray = np.empty((len(z), len(y), len(x)), kind)
        gather_block(array, z, y, x, kind(0 if beyond is None else beyond), out)
        return out

    def grown(self, reach: int, shape: tuple[int, ...]) -> Block:
        """A block that reaches further on each side, as far as there are voxels."""
        z, y, x = ((max(a - reach, 0), min(b + reach, n)) for a, b, n in self._sides(shape))
        return Block((z[0], y[0], x[0]), (z[1], y[1], x[1]))

    def _sides(self, shape: tuple[int, ...]) -> Iterable[tuple[int, int, int]]:
        return zip(self.start, self.stop, shape, strict=True)


def blocks_of(shape: tuple[int, ...], box: Box | None = None) -> list[Block]:
    """Blocks that fill a volume, or a box of it."""
    ends = [(0, n) for n in shape] if box is None else [(s.start, s.stop) for s in box]
    cuts = [[(a, min(a + edge, high)) for a in range(low, high, edge)] for (low, high), edge in zip(ends, EDGES)]
    return [Block((z[0], y[0], x[0]), (z[1], y[1], x[1])) for z, y, x in itertools.product(*cuts)]


def slabs_of(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """First and last (excluded) plane of slabs that fill a volume."""
    planes = max(1, SLAB_VOXELS // max(1, int(np.prod(shape[1:]))))
    return [(a, min(a + planes, shape[0])) for a in range(0, shape[0], planes)]


def chunks_of(size: int) -> list[slice]:
    """Parts of a flat array."""
    return [slice(a, min(a + SLAB_VOXELS, size)) for a in range(0, size, SLAB_VOXELS)]


class Work:
    """Threads that go through the parts of a volume, and what they tell about it."""

    def __init__(self, progress: Progress | None = None, threads: int | None = None) -> None:
        self.threads = threads or numba.get_num_threads()
        self._progress, self._message = progress, ""
        self._done, self._until, self._each = 0.0, 0.0, 0.0
        self._told = 0.0

    def begin(self, message: str, until: int, passes: int) -> None:
        """A part of the work, which ends at so many percent of the whole, in about so many passes."""
        self._message, self._done = message, self._until
        self._until, self._each = float(until), (until - self._done) / max(passes, 1)
        self._tell(0.0)

    def end(self, message: str) -> None:
        """All is done."""
        self._message, self._done = message, float(PERCENT)
        self._tell(0.0)

    def each(self, items: Iterable[Item], work: Callable[[Item], Result]) -> list[Result]:
        """Results of a function for all items, in their order."""
        numbered = list(enumerate(items))

        def add(item: tuple[int, Item], results: list[tuple[int, Result]]) -> list[tuple[int, Result]]:
            results.append((item[0], work(item[1])))
            return results

        parts = self.gathered(numbered, list, add)
        return [result for _, result in sorted(itertools.chain(*parts), key=lambda pair: pair[0])]

    def gathered(
        self, items: Sequence[Item], start: Callable[[], Result], add: Callable[[Item, Result], Result]
    ) -> list[Result]:
        """What each thread gathered: ``start()``, to which ``add(item, gathered)`` added the items it took."""
        lock, rest, count = threading.Lock(), iter(items), [0]

        def run() -> Result:
            found = start()
            while True:
                with lock:
                    item = next(rest, _END)
                if item is _END:
                    return found
                found = add(item, found)  # type: ignore[arg-type]
                count[0] += 1

        pool = ThreadPoolExecutor(max(1, min(self.threads, len(items))))
        try:
            futures = [pool.submit(run) for _ in range(max(1, min(self.threads, len(items))))]
            pending = set(futures)
            while pending:
                pending = wait(pending, timeout=TELL_SECONDS).not_done
                self._tell(count[0] / max(len(items), 1))
        finally:
            with lock:
                rest = iter(())  # after an interrupt nothing more is begun
            pool.shutdown(wait=True)
        self._done = min(self._done + self._each, self._until)
        return [future.result() for future in futures]

    def _tell(self, share: float) -> None:
        now = time.monotonic()
        if self._progress is not None and (share == 0 or now - self._told >= TELL_SECONDS):
            self._told = now
            done = min(self._done + share * self._each, self._until) if self._done < PERCENT else PERCENT
            self._progress(self._message, int(done), PERCENT)


_END = object()


def _places(low: int, high: int, n: int, mirrored: bool) -> NDArray[np.int64]:
    """Indices from ``low`` up to ``high``; beyond 0 … n - 1 those of the mirror image, or -1."""
    places = np.arange(low, high)
    if not mirrored:
        return np.where((places < 0) | (places >= n), -1, places)
    places = places % (2 * n)  # … 1 0 | 0 1 … n-1 | n-1 n-2 …
    return np.where(places < n, places, 2 * n - 1 - places)
