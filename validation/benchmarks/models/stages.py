"""A whole run on a cluster as formulas: what each stage holds, moves and takes, from the size of the scan.

Bytes follow from the arrays that the code makes; seconds are CPU seconds of one thread, from runs of 320³ voxels.
N³ voxels, V views of N × N pixels, n grains d voxels across, on W nodes with T threads each, of which one also holds
the client.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grainmotion.cluster.distributed_iterate import VIEWS_BETWEEN_CHECKPOINTS
from grainmotion.reconstruction.ordered_subsets import subsets
from grainmotion.reconstruction.slabs import slab_bounds
from grainmotion.segmentation.label_refinement import SPLINE_MARGIN
from grainmotion.segmentation.settings import SegmentSettings

SINGLE, LABEL, COMPACT = 4, 4, 2
"""Bytes of a voxel or pixel, of a label, and of a finer voxel that is kept compactly."""
REACH, FINER, PADDING = SegmentSettings().reach, SegmentSettings().finer, 2
COPIES_OF_A_SLAB = 4
"""Image and the one before, and the copies that an update makes of both."""
SLAB_OVERLAP = 1.15
"""Rows of pixels that slabs need over the rows of the panel: those of a cone overlap."""
COARSE_SHARE = 1 / 2 / 4
"""Of what is read: every second view, a pixel of four, for the coarse start."""
SEGMENTED_BYTES = 9.5
"""Bytes a voxel that segmentation holds beside the volume (decision 0049)."""
SOLVED_PIXEL_BYTES = 2 * 28
"""Line integrals and six derivatives of a pixel of a patch, of the pose in hand and of the one before."""
PATCH_MARGIN = 4
"""Pixels about a grain's shadow."""


@dataclass(frozen=True)
class Rates:
    """CPU seconds of one thread.

    ``pixel`` of reading and checking a pixel, ``view`` of calibrating with a view, ``sample`` of a voxel that a ray
    crosses in the reconstruction, ``voxel`` of segmentation, ``fine`` of a finer voxel of a grain's crop, ``tracked``
    of a voxel of a grain in a state; ``start`` of all checks whose cost does not depend on the size.
    """

    start: float
    pixel: float
    view: float
    sample: float
    voxel: float
    fine: float
    tracked: float


@dataclass(frozen=True)
class Plan:
    """The size of a run and of the cluster."""

    size: int
    views: int
    grains: int
    diameter: float
    workers: int
    threads: int = 1
    states: int = 1
    state_views: int = 4

    @property
    def voxels(self) -> float:
        """Of the volume."""
        return float(self.size) ** 3

    @property
    def pixels(self) -> float:
        """Of all radiographs of the reference."""
        return float(self.views) * self.size**2

    @property
    def crop(self) -> float:
        """Voxels around a grain from which its finer ones are made."""
        return (self.diameter + 2 * (math.ceil(REACH) + SPLINE_MARGIN)) ** 3

    @property
    def fine_box(self) -> float:
        """Finer voxels of the box around a grain."""
        return (FINER * (self.diameter + 1.5) + 2 * PADDING) ** 3

    @property
    def coarse_box(self) -> float:
        """Voxels of the box around a grain."""
        return (self.diameter + 2 * REACH + 2 * PADDING) ** 3

    @property
    def compact(self) -> float:
        """Bytes of all grains' finer voxels, kept compactly."""
        inside = math.pi / 6 * (FINER * (self.diameter + 1.5)) ** 3
        return self.grains * (COMPACT * inside + 4 * self.fine_box ** (2 / 3))

    @property
    def own_grains(self) -> float:
        """Bytes of all grains with their own voxels."""
        return SINGLE * self.grains * self.coarse_box + self.compact

    @property
    def slabs(self) -> int:
        """Of the reconstruction."""
        return len(slab_bounds((self.size,) * 3))

    @property
    def busy(self) -> int:
        """Workers that have a slab."""
        return min(self.workers, self.slabs)

    @property
    def walked(self) -> int:
        """Views that all updates use."""
        return sum(len(part) for phase in subsets(self.views) for part, _ in phase)

    @property
    def patch_pixels(self) -> float:
        """Pixels of all patches of a state, at a pixel a voxel."""
        return self.grains * self.state_views * (self.diameter + 2 * PATCH_MARGIN) ** 2


@dataclass(frozen=True)
class Cost:
    """A stage: bytes held by the client and by a worker at most, bytes sent between workers and read and written as
    files by all, CPU seconds of the client and of all workers, and how many threads the workers use."""

    name: str
    client: float
    worker: float
    between: float
    files: float
    client_seconds: float
    worker_seconds: float = 0.0
    parallel: int = 1

    def seconds(self, threads: int, network: float, storage: float, workers: int) -> float:
        """Expected by the clock: the client's share, the workers', and what travels meanwhile."""
        computed = self.client_seconds / threads + self.worker_seconds / self.parallel
        return computed + self.between / workers / network + self.files / storage


def reading(plan: Plan, rates: Rates) -> Cost:
    """Radiographs of the reference, in the client; trials of the geometry by workers."""
    held = SINGLE * plan.pixels
    return Cost("reading, checks", held, 0, 0, 2 * plan.pixels, rates.pixel * plan.pixels, rates.start, 1)


def calibration(plan: Plan, rates: Rates) -> Cost:
    """Binned radiographs; a trial reconstruction is a task of one thread or more."""
    binned = SINGLE * plan.views * 64.0**2
    trials = binned * 40  # searches, derivatives: each task reads the views that it needs
    seconds = rates.view * plan.views
    return Cost(
        "calibration", SINGLE * plan.pixels, 3 * binned, 0, trials, 0.05 * seconds, seconds, min(plan.workers, 8)
    )


def reconstruction(plan: Plan, rates: Rates) -> Cost:
    """Slabs held by workers; the volume comes to the client by files."""
    slab = plan.voxels / plan.slabs
    rows = SINGLE * plan.pixels * SLAB_OVERLAP / plan.slabs
    each = math.ceil(plan.slabs / plan.workers)
    read = SINGLE * plan.pixels / plan.busy
    between = SINGLE * plan.pixels * (1 + COARSE_SHARE) * (1 - 1 / plan.busy)
    strips = (plan.busy - 1) * 2 * SINGLE * plan.size * (plan.size / plan.slabs) * SLAB_OVERLAP * plan.walked
    checkpoints = plan.walked // max(VIEWS_BETWEEN_CHECKPOINTS, plan.views // 2)
    stored = SINGLE * plan.voxels * (2 * checkpoints + 2)  # image and the one before; at the end the image, read again
    seconds = rates.sample * plan.voxels * plan.walked
    return Cost(
        "reconstruction",
        SINGLE * plan.voxels,
        each * (COPIES_OF_A_SLAB * SINGLE * slab + rows) + read,
        between + strips,
        2 * plan.pixels + stored,
        0.02 * seconds / plan.busy,
        seconds,
        plan.busy * plan.threads,
    )


def segmentation(plan: Plan, rates: Rates) -> Cost:
    """By the client's threads alone."""
    held = (SINGLE + SEGMENTED_BYTES) * plan.voxels
    return Cost("segmentation", held, 0, 0, 0, rates.voxel * plan.voxels)


def cutting(plan: Plan, rates: Rates) -> Cost:
    """Crops read from files by workers, upsampled grains sent to the client; then all is written."""
    fine = plan.grains * plan.crop * FINER**3
    to_client = SINGLE * plan.grains * (FINER * (plan.diameter + 1.5)) ** 3
    crops = (SINGLE + LABEL) * plan.grains * plan.crop
    stored = (SINGLE + LABEL) * plan.voxels
    held = (SINGLE + 2 * LABEL) * plan.voxels + plan.own_grains
    one = 4 * (SINGLE + LABEL) * 3 * plan.crop * FINER**3
    return Cost(
        "cutting", held, one, to_client, 2 * stored + crops, 2e-9 * plan.voxels + 2e-8 * fine, rates.fine * fine,
        plan.workers,
    )  # fmt: skip


SHARED_VOXELS, SOLVED, PRODUCTS = 5e7, 100, 900
"""Voxels of grains from which a sample is divided; evaluations with derivatives and products with the normal matrix of
a state (measured: 103 and 909 for 800 grains)."""


def tracking(plan: Plan, rates: Rates) -> Cost:
    """A state: by a team, each member with all grains; or divided, each worker with a part of them."""
    images = SINGLE * plan.state_views * plan.size**2
    seconds = plan.states * rates.tracked * plan.grains * plan.diameter**3
    patches, client = SOLVED_PIXEL_BYTES * plan.patch_pixels / plan.workers, plan.own_grains + 20 * images
    band = (plan.diameter + 2 * PATCH_MARGIN) * 1.3  # rows that two neighbours along z share, and the cone's
    shared = 2 * (plan.workers - 1) * 2 * SINGLE * plan.state_views * plan.size * band
    gradients = plan.grains * plan.state_views * 6 * 8.0
    divided = plan.grains * plan.coarse_box >= SHARED_VOXELS
    if not divided:
        exchanged = PRODUCTS * (shared + gradients * (plan.workers - 1)) + 1.3 * SOLVED * 2 * images * plan.workers
        held = plan.own_grains + patches + 20 * images
        return Cost("tracking", client, held, plan.states * exchanged, 2 * plan.own_grains * plan.workers,
                    0.02 * seconds, seconds, plan.workers * plan.threads)  # fmt: skip
    fine = SINGLE * plan.grains * plan.fine_box
    travelled = PRODUCTS * shared + 1.3 * SOLVED * (2 * images * math.log2(max(plan.workers, 2)))
    held = (fine + SINGLE * plan.grains * plan.coarse_box) / plan.workers + patches
    client_seconds = plan.states * (PRODUCTS * (2e-3 * plan.workers + gradients * 2e-9) + SOLVED * 5e-3 * plan.workers)
    return Cost("tracking", client, held, plan.states * travelled, 2 * plan.own_grains, client_seconds, seconds,
                plan.workers * plan.threads)  # fmt: skip


STAGES = (reading, calibration, reconstruction, segmentation, cutting, tracking)


def costs(plan: Plan, rates: Rates) -> list[Cost]:
    """All stages in their order."""
    return [stage(plan, rates) for stage in STAGES]


def diameter_of(size: int, grains: int, filled: float = 0.136) -> float:
    """Diameter, voxels, of grains that fill this share of the volume."""
    return float(np.cbrt(6 / np.pi * filled * float(size) ** 3 / grains))
