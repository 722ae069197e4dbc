"""A grain of a large sample and those around it as a small sample: windows of the radiographs, less all else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Image
from grainmotion.backends.cpu import CPU
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.scene import Scene
from grainmotion.objective.data_term import Target
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.rotations import rotation_vector
from grainmotion.tracking.attempt import Attempt, Job
from grainmotion.tracking.ellipsoids import ellipsoid_images
from grainmotion.tracking.few_grains import with_neighbours

PART_DIAMETERS = 2.0
"""Grain diameters from the middle one within which grains belong to a part: some 40."""
MARGIN_DIAMETERS = 1.0
"""How far windows reach beyond the shadows of a part, as its grains may be sought so far away."""


@dataclass(frozen=True, eq=False)
class Part:
    """Some grains of a sample, the ``rows (m,)``, as the job of a small sample around the grain of row ``middle``.

    ``bad (m,)`` are those that fit badly; ``first (views, 2)`` are row and column of the first pixel of each window.
    """

    rows: NDArray[np.int64]
    middle: int
    bad: NDArray[np.bool_]
    job: Job
    first: NDArray[np.int64]

    def image(self, target: Target, attempt: Attempt) -> Image | None:
        """Line integrals of new grains and pieces ``(views, rows, columns)`` on the radiographs, None for none."""
        if not attempt.new and attempt.pieces is None:
            return None
        image = np.zeros(target.scan.line_integrals.shape, target.precision)
        if attempt.new:
            image += ellipsoid_images(attempt.new, target.scan.geometry)
        if attempt.pieces is not None:
            for view, (row, column) in enumerate(self.first):
                height, width = attempt.pieces[view].shape
                image[view, row : row + height, column : column + width] += attempt.pieces[view]
        return image


@dataclass(frozen=True, eq=False)
class Whole:
    """A large sample at a pose.

    ``left (views, rows, columns)`` is what its radiographs hold beside everything that is known, as line integrals, and
    ``squares`` are ΣP² of its grains.
    """

    job: Job
    problem: StateProblem
    pose: Pose
    left: Image
    squares: Image

    @classmethod
    def at(cls, job: Job, problem: StateProblem, pose: Pose) -> Whole:
        """Simulate and compare the whole sample once."""
        evaluation = problem.evaluate(pose)
        values = np.asarray(evaluation.values)
        squares = assemble(values**2, evaluation.patches, problem.target.scan.geometry)
        return cls(job, problem, pose, evaluation.left_path, squares)

    def part(self, middle: int, bad: NDArray[np.bool_], field_pose: Pose) -> Part:
        """The part around the grain of row ``middle``; those that are ``bad (n,)`` start from ``field_pose``."""
        target, own = self.problem.target, self.problem.grains
        rows = with_neighbours(self.problem, self.pose, np.array([middle]), PART_DIAMETERS)
        some = replace(own.select(rows), backend=CPU, placed=None)
        at = Pose(self.pose.translations[rows], self.pose.matrices[rows])
        geometry = target.scan.geometry
        reach = MARGIN_DIAMETERS * 2 * float(np.median(some.radii)) / geometry.pixel_at(some.centers.mean(axis=0))
        boxes = footprint_patches(some, at, geometry, margin=int(np.ceil(reach))).boxes
        first, shape = _windows(boxes, geometry)
        window = geometry.window(first, shape)
        patches = footprint_patches(some, at, window)
        values = project_patches(some, at, window, patches, target.projector)
        images, squares = (assemble(each, patches, window) for each in (values, values**2))
        left, all_squares, valid = (_cropped(each, first, shape) for each in (self.left, self.squares, target.valid))
        grains = self.job.grains
        scene = Scene(
            field=None if grains.scene.field is None else replace(grains.scene.field, above=False, below=False)
        )
        part = replace(grains, grains=tuple(grains.grains[row] for row in rows), scene=scene)
        start = replace(
            Motions.identity(part.labels, part.centers),
            translations=np.where(bad[rows, None], field_pose.translations[rows], at.translations),
            rotations=rotation_vector(np.where(bad[rows, None, None], field_pose.matrices[rows], at.matrices)),
        )
        settings = replace(
            self.job.settings, fields=False, gain="none", trend="none", hardening=1, weights="uniform",
            loss="squares", view_corrections="never", alternatives=False,
        )  # fmt: skip
        others = np.maximum(all_squares - squares, 0)
        job = Job(
            part,
            Scan(images + left, window, valid > 0),
            start,
            settings,
            None,
            CPU,
            other_squares=others,
            most_sought=1,
        )
        return Part(rows, middle, bad[rows], job, first)


def _windows(boxes: NDArray[np.int64], geometry: Geometry) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """First pixels ``(views, 2)`` and shape of windows of one size that hold the boxes of all patches."""
    panel = np.array(geometry.shape)
    low, high = np.tile(panel, (len(geometry), 1)), np.zeros((len(geometry), 2), np.int64)
    np.minimum.at(low, boxes[:, 1], boxes[:, [2, 4]])
    np.maximum.at(high, boxes[:, 1], boxes[:, [3, 5]])
    low = np.minimum(low, high)  # a view that sees none of them
    rows, columns = np.maximum((high - low).max(axis=0), 1)
    shape = int(rows), int(columns)
    return np.clip((low + high - shape) // 2, 0, panel - shape), shape


def _cropped(images: Image, first: NDArray[np.int64], shape: tuple[int, int]) -> Image:
    """Windows of images ``(views, rows, columns)``."""
    rows, columns = shape
    return np.stack([image[r : r + rows, c : c + columns] for image, (r, c) in zip(images, first, strict=True)])
