"""What a cluster sends and how long it takes, as formulas; every number is of one evaluation or one update.

Tracking: B blocks of neighbours along z, each shading h = R/B + d rows of a panel of R rows (d rows a grain), on W
workers that hold neighbouring blocks.  Reconstruction: S slabs, and subsets of m views.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SINGLE, DOUBLE, BLOCK = 4, 8, 6 * 6 * 8
COLUMNS = 2
"""Unknowns of the response, as images: gain and offset."""


@dataclass(frozen=True)
class Network:
    """A cluster: bytes a second into or out of a node, seconds from a task to the next and of the scheduler a task."""

    rate: float = 1.25e9
    hop: float = 5e-3
    task: float = 1e-3

    @property
    def sentence(self) -> str:
        """What is assumed."""
        return (
            f"Assumed: {self.rate / 1e9:g} GB/s a node, {1e3 * self.hop:g} ms from a task to the next, "
            f"{1e3 * self.task:g} ms of the scheduler a task; nodes send at once, but for what goes to or from one."
        )


@dataclass(frozen=True)
class Cost:
    """Seconds of one core for what is shared, tasks and hops, and bytes."""

    shared: float
    parts: int
    workers: int
    tasks: int
    hops: int
    between_workers: float
    through_one: float
    to_client: float

    def seconds(self, network: Network) -> float:
        """Expected, if the parts are spread evenly."""
        rounds = math.ceil(self.parts / self.workers) / self.parts
        wires = max(self.between_workers / self.workers, self.through_one) / network.rate
        return self.shared * rounds + max(self.hops * network.hop, self.tasks * network.task) + wires


@dataclass(frozen=True)
class Sample:
    """Grains, views of a state, panel, grain size (pixels), filter's reach; volume, views of its scan; CPU seconds."""

    grains: int
    views: int
    rows: int
    columns: int
    diameter: float
    margin: int
    planes: int
    subset: int
    evaluation: float
    update: float

    @classmethod
    def of_benchmark(cls, grains: int, shape: tuple[int, int, int]) -> Sample:
        """The case of ``benchmarks/cluster.py``."""
        return cls(grains, 4, shape[0], shape[1], 33.0, 3, shape[0], 352 // 44, 0.0, 0.0)

    @classmethod
    def large(cls) -> Sample:
        """10,000 grains on 2,000³ voxels; 1 µs a ray and 50 voxels with derivatives, 13 ns a voxel's ray step."""
        rays = 10_000 * 4 * 96.0**2
        return cls(10_000, 4, 2_000, 2_000, 96.0, 3, 2_000, 68, rays * 1e-6 * 96 / 50, 68 * 2_000.0**3 * 3e-9)

    @property
    def blocks(self) -> int:
        """As `cluster.blocks.block_rows`."""
        return min(self.grains, max(2, round(self.grains / max(6.0, math.sqrt(self.grains) / 2))))

    @property
    def patch(self) -> float:
        """Pixels of a grain's patch."""
        return (self.diameter + 2 * self.margin) ** 2


def tracking(of: Sample, workers: int) -> Cost:
    """One evaluation of the residual with its normal equations."""
    blocks, away = of.blocks, min(workers, of.blocks) - 1
    rows = min(of.rows, of.rows / blocks + of.diameter + 2 * of.margin)
    stack = of.views * of.columns
    levels = max(0, math.ceil(math.log(blocks, 4)) - 1)
    # the last few parts, and the rows where blocks of two workers meet, travel; a worker adds its own up itself
    summed = DOUBLE * stack * (of.rows * (1 - 1 / workers) + away * rows * min(levels, 1))
    images = SINGLE * (2 + COLUMNS) * stack
    sent = images * (of.rows * away if blocks <= 16 else rows * blocks * (1 - 1 / workers))
    lent = away * of.grains * min(0.5, (of.diameter + 2 * of.margin) / of.rows) * of.views * of.patch * 6 * SINGLE
    partners = min(blocks - 1, rows * blocks / of.rows)
    pairs = (
        of.grains
        * min(of.grains, 2 * of.grains * of.diameter / of.rows)
        * min(1.0, of.views * of.diameter / of.columns)
    )
    tasks = int(blocks * (3 + (blocks > 16) + partners) + blocks / 3)
    client = BLOCK * pairs / 2 + of.grains * 6 * 8 * (1 + COLUMNS + COLUMNS)
    return Cost(of.evaluation, blocks, workers, tasks, 6 + levels, summed + sent + lent, sent, client)


def reconstruction(of: Sample, workers: int) -> Cost:
    """One update by a subset of views: forward, compare, advance, one after the other in every slab."""
    slabs = min(of.planes, max(2, round(of.planes / 128)))
    borders = min(workers, slabs) - 1  # where the rows of two workers' slabs meet, each gets the other's strip
    strips = borders * 2 * SINGLE * of.subset * of.columns * of.rows / slabs
    squares = 2 * DOUBLE * of.rows
    return Cost(of.update, slabs, min(workers, slabs), 4 * slabs, 3, strips, 0.0, squares)
