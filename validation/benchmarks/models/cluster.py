"""What a cluster sends and how long it takes, as formulas; every number is of one evaluation, product or update.

Tracking: as many pieces as workers, W, neighbours along z, each shading h = (R − p)/W + p rows of R (p rows a patch).
Reconstruction: S slabs, and subsets of m views.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from grainmotion.reconstruction.slabs import slab_bounds

SINGLE_BYTES, DOUBLE_BYTES, BLOCK_BYTES = 4, 8, 6 * 6 * 8
RESPONSE_COLUMNS = 2
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
    """Grains, views of a state, rows and columns of the panel that they shade, grain size (pixels), filter's reach;
    volume, views of its scan; CPU seconds of an evaluation, a product with the normal matrix, an update."""

    grains: int
    views: int
    rows: int
    columns: int
    diameter: float
    margin: int
    planes: int
    subset: int
    evaluation: float
    product: float
    update: float

    @classmethod
    def of_benchmark(cls, grains: int, shape: tuple[int, int, int], views: int) -> Sample:
        """The case of ``validation/benchmarks/cluster.py``."""
        return cls(grains, 4, shape[0], shape[1], 33.0, 3, shape[0], views // 44, 0.0, 0.0, 0.0)

    @classmethod
    def large(cls) -> Sample:
        """10,000 grains on 2,000³ voxels; 1 µs a ray and 50 voxels with derivatives, 10 ns a patch's pixel in a
        product (measured: 5.6 ms for 200 grains of 24 voxels), 13 ns a voxel's ray step."""
        rays, pixels = 10_000 * 4 * 96.0**2, 10_000 * 4 * 102.0**2
        return cls(
            10_000, 4, 2_000, 2_000, 96.0, 3, 2_000, 68, rays * 1e-6 * 96 / 50, pixels * 10e-9, 68 * 2_000.0**3 * 3e-9
        )

    @property
    def patch(self) -> float:
        """Rows of a grain's patch, and its columns."""
        return self.diameter + 2 * self.margin

    def stripe(self, pieces: int) -> float:
        """Rows that a piece shades."""
        return (self.rows - self.patch) / pieces + self.patch

    def meetings(self, pieces: int) -> int:
        """Ordered pairs of pieces that share rows."""
        band = max((self.rows - self.patch) / pieces, 1e-9)
        reach = math.ceil(self.stripe(pieces) / band) - 1
        return sum(min(pieces - 1, k + reach) - max(0, k - reach) for k in range(pieces))


TREE_ARITY = 4
"""Parts of the radiographs that one task adds up."""


def tracking(of: Sample, workers: int) -> Cost:
    """One evaluation of the residual with its gradient and the blocks on the diagonal; up to 100 grains, all blocks."""
    stack, height = of.views * of.columns, of.stripe(workers)
    parts, across, tasks, hops = workers, 0.0, 5 * workers, 6
    while parts > TREE_ARITY:  # the tree: of each group all but one travel
        groups = math.ceil(parts / TREE_ARITY)
        across += (parts - groups) * DOUBLE_BYTES * stack * min(of.rows, of.stripe(parts))
        parts, tasks, hops = groups, tasks + groups, hops + 1
    home = parts * DOUBLE_BYTES * stack * min(of.rows, of.stripe(parts)) + of.grains * (
        of.views * 6 * DOUBLE_BYTES * (1 + RESPONSE_COLUMNS) + BLOCK_BYTES
    )
    stored = SINGLE_BYTES * (2 + RESPONSE_COLUMNS) * stack * height * workers
    if 6 * of.grains <= 600:
        met = of.grains * min(1.0, of.patch / of.rows) * (workers - 1)  # grains whose patches reach into another piece
        across += met / 2 * of.views * of.patch**2 * 6 * SINGLE_BYTES
        home += of.grains**2 / 4 * BLOCK_BYTES
    return Cost(of.evaluation, workers, workers, tasks, hops, across + stored, home, home)


def product(of: Sample, workers: int, columns: int = 1) -> Cost:
    """One product of the normal matrix with so many columns."""
    stripe = DOUBLE_BYTES * columns * of.views * of.columns * of.stripe(workers)
    home = of.grains * of.views * 6 * DOUBLE_BYTES * columns
    return Cost(columns * of.product, workers, workers, 2 * workers, 4, of.meetings(workers) * stripe, home, home)


def reconstruction(of: Sample, workers: int) -> Cost:
    """One update by a subset of views: line integrals, then compare and advance, in every slab."""
    slabs = len(slab_bounds((of.planes, of.columns, of.columns)))
    borders = min(workers, slabs) - 1  # where the rows of two workers' slabs meet, each gets the other's strip
    strips = borders * 2 * SINGLE_BYTES * of.subset * of.columns * of.rows / slabs
    squares = 2 * DOUBLE_BYTES * of.rows
    return Cost(of.update, slabs, min(workers, slabs), 3 * slabs, 2, strips, 0.0, squares)
