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
from grainmotion.segmentation.extraction import MAX_CUT_BYTES
from grainmotion.segmentation.label_refinement import SPLINE_MARGIN
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.workflow.given_checks import MAX_SHARED_VOXELS

SINGLE, DOUBLE, LABEL, COMPACT = 4, 8, 4, 1
"""Bytes of a voxel or pixel, of a sum, of a label, and of a finer voxel that is kept compactly."""
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
BINNED, CHECKS, TRIALS, RESIDUALS, TIMES_READ = 60.0, 10, 22, 7, 3
"""Columns of binned radiographs; trials of checks and of the calibration, those of the latter that send residuals (in
double precision); times that files of radiographs are read (fingerprints, checks, by workers)."""
PATCH_MARGIN = 4
"""Pixels about a grain's shadow."""


@dataclass(frozen=True)
class Rates:
    """CPU seconds of one thread.

    ``pixel`` of reading and checking a pixel, ``view`` of calibrating with a view, ``sample`` of a voxel that a ray
    crosses in the reconstruction, ``voxel`` of segmentation, ``fine`` of a finer voxel of a grain's crop, ``kept`` of
    one for the client, ``grown`` of a voxel of the labels that are grown, ``tracked`` of a voxel of a grain in a state;
    ``start`` of all checks whose cost does not depend on the size.
    """

    start: float
    pixel: float
    view: float
    sample: float
    voxel: float
    fine: float
    tracked: float
    kept: float = 2e-8
    grown: float = 1.5e-7


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
    def reached(self) -> float:
        """Voxels across a grain with the attenuation within reach of its label."""
        return self.diameter + 2 * REACH

    @property
    def fine_box(self) -> float:
        """Finer voxels of the box around a grain."""
        return (FINER * self.reached + 2 * PADDING) ** 3

    @property
    def coarse_box(self) -> float:
        """Voxels of the box around a grain."""
        return (self.reached + 2 * PADDING) ** 3

    @property
    def own_grains(self) -> float:
        """Bytes of all grains with their own voxels, as they are kept."""
        boxes = self.coarse_box, self.fine_box
        if SINGLE * self.grains * self.fine_box <= MAX_CUT_BYTES:
            return SINGLE * self.grains * sum(boxes)
        inside = math.pi / 6 * self.reached**3 * (1 + FINER**3)
        return self.grains * (COMPACT * inside + 4 * sum(box ** (2 / 3) for box in boxes))

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
    """A stage: bytes held by the client and by a worker at most, bytes sent by workers, bytes of files read and written
    by all and of those read through mapped files, CPU seconds of the client and of all workers, and how many threads
    these use."""

    name: str
    client: float
    worker: float
    between: float
    files: float
    client_seconds: float
    worker_seconds: float = 0.0
    parallel: int = 1
    mapped: float = 0.0

    def seconds(self, threads: int, network: float, storage: float, workers: int) -> float:
        """Expected by the clock: the client's share, the workers', and what travels meanwhile."""
        computed = self.client_seconds / threads + self.worker_seconds / self.parallel
        return computed + self.between / workers / network + (self.files + self.mapped) / storage


def reading(plan: Plan, rates: Rates) -> Cost:
    """Radiographs of the reference, in the client; trials of the geometry by workers."""
    held, trials = SINGLE * plan.pixels, CHECKS * SINGLE * plan.views * BINNED**2
    read = TIMES_READ * 2 * plan.pixels
    return Cost("reading, checks", held, 0, 0, read + trials, rates.pixel * plan.pixels, rates.start, 4)


def calibration(plan: Plan, rates: Rates) -> Cost:
    """Binned radiographs; a trial reconstruction is a task of one thread or more."""
    binned = SINGLE * plan.views * BINNED**2
    seconds, held = rates.view * plan.views, SINGLE * plan.pixels
    return Cost("calibration", held, 3 * binned, 2 * RESIDUALS * binned, TRIALS * binned, 0.08 * seconds,
                0.92 * seconds, min(plan.workers, 8))  # fmt: skip


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
    to_client = plan.own_grains
    crops = (SINGLE + LABEL) * plan.grains * plan.crop
    stored = (SINGLE + LABEL) * plan.voxels + SINGLE * plan.voxels  # for workers; results, compressed
    held = (SINGLE + LABEL) * plan.voxels + plan.own_grains
    one = 4 * (SINGLE + LABEL) * 3 * plan.crop * FINER**3
    return Cost(
        "cutting", held, one, to_client, stored, rates.grown * plan.voxels + rates.kept * fine, rates.fine * fine,
        plan.workers, crops,
    )  # fmt: skip


SHARED_VOXELS, EVALUATIONS, PRODUCTS = 5e7, 46, 1300
"""Voxels of grains from which a sample is divided; evaluations of a state, and columns that are multiplied with the
normal matrix (800 grains: 29 evaluations with derivatives and 17 without; 309 products of one to 16 columns, 1,300
columns by the bytes that two workers sent)."""


def tracking(plan: Plan, rates: Rates) -> Cost:
    """Checks of grains, and a state: by a team, each worker with all grains; or divided, each with a part of them."""
    images, workers = plan.state_views * float(plan.size) ** 2, plan.workers
    seconds = plan.states * rates.tracked * plan.grains * plan.diameter**3
    patches = SOLVED_PIXEL_BYTES * plan.patch_pixels / workers
    band = 1.3 * (plan.diameter + 2 * PATCH_MARGIN)  # rows that neighbours along z share, with the cone's
    shared = 2 * (workers - 1) * DOUBLE * plan.state_views * plan.size * band
    gradients = DOUBLE * plan.grains * plan.state_views * 6
    lit = plan.state_views * plan.size * (0.8 * plan.size + workers * band)  # what all members have, with common rows
    checked = 2 * (SINGLE + LABEL) * plan.voxels if plan.voxels <= MAX_SHARED_VOXELS else 0.0  # read by two checks
    client, threads = plan.own_grains + 20 * SINGLE * images, workers * plan.threads
    if plan.grains * plan.coarse_box < SHARED_VOXELS:
        sent = PRODUCTS * (shared + gradients * (workers - 1)) + EVALUATIONS * DOUBLE * lit * (workers - 1)
        files = checked + plan.own_grains * (1 + workers)
        held = plan.own_grains + patches + 20 * SINGLE * images
        return Cost("tracking", client, held, plan.states * sent, files, 0.15 * seconds, 0.85 * seconds, threads)
    sent = PRODUCTS * shared + EVALUATIONS * DOUBLE * lit * math.log2(max(workers, 2))
    voxels = SINGLE * plan.grains * (plan.fine_box + plan.coarse_box)
    tasks = PRODUCTS * (2e-3 * workers + 2e-9 * gradients) + EVALUATIONS * 5e-3 * workers
    files = checked + 2 * plan.own_grains
    return Cost("tracking", client, voxels / workers + patches, plan.states * sent, files, plan.states * tasks,
                seconds, threads)  # fmt: skip


STAGES = (reading, calibration, reconstruction, segmentation, cutting, tracking)


def costs(plan: Plan, rates: Rates) -> list[Cost]:
    """All stages in their order."""
    return [stage(plan, rates) for stage in STAGES]


def diameter_of(size: int, grains: int, filled: float = 0.136) -> float:
    """Diameter, voxels, of grains that fill this share of the volume."""
    return float(np.cbrt(6 / np.pi * filled * float(size) ** 3 / grains))
