"""Derivatives of radiographs by the grains' strains, in the patches of their derivatives by the motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion._typing import Projector
from grainmotion.backends.cpu import CPU
from grainmotion.kernels.layout import ViewTable
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import Patches
from grainmotion.projection.grain_arrays import GrainArrays, planar
from grainmotion.projection.jacobian import PatchJacobian

OUT_OF_PLANE_STRAINS = (2, 3, 4)
"""Strains that a planar sample does not show: zz, yz, xz."""


def differentiate_by_strain(
    grains: GrainArrays, pose: Pose, geometry: Geometry, patches: Patches, projector: Projector
) -> PatchJacobian:
    """Derivatives by the six strains of each grain (see `model.strain`), on the CPU; rigid grains have strain zero."""
    if grains.stretches is None:
        grains = grains.stretched(np.tile(np.eye(3), (len(grains), 1, 1)))
    views = ViewTable(geometry.vectors, geometry.beam == "cone", np.array(geometry.shape))
    tables = grains.table(pose), views, patches.table, projector == "exact"
    _, _, derivatives = CPU.project_with_strain_derivatives(*tables)
    if planar(grains, geometry):
        derivatives[list(OUT_OF_PLANE_STRAINS)] = 0
    return PatchJacobian(derivatives, patches)


def joined(by_motion: PatchJacobian, by_strain: PatchJacobian) -> PatchJacobian:
    """The derivatives of n grains by motion and by strain as those of 2n, on the CPU: strains follow motions.

    Every grain then has two rows of six unknowns, whose patches coincide, and all products work as they are.
    """
    patches = by_motion.patches
    n, boxes = len(by_motion), patches.boxes.copy()
    boxes[:, 0] += n
    both = replace(
        patches, boxes=np.concatenate([patches.boxes, boxes]), jobs=patches.jobs[:0], seen=np.tile(patches.seen, (2, 1))
    )
    parts = [np.asarray(by_motion.derivatives), np.asarray(by_strain.derivatives)]
    return PatchJacobian(np.concatenate(parts, axis=1), both)
