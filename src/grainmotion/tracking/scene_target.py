"""The data term of a state with the bodies of a scene: those that may not move are projected once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.backends.base import PatchBackend
from grainmotion.model.grains import GrainSet
from grainmotion.model.scan import Scan
from grainmotion.model.scene import NO_MOTION, Body, Freedom
from grainmotion.objective.data_term import Target
from grainmotion.objective.nuisance_motions import NuisanceModel
from grainmotion.projection.bodies import packed_body
from grainmotion.tracking.settings import TrackSettings

BODY_SHIFT_SD, BODY_ROTATION_SD = 20.0, 0.1
"""Voxels, radians: standard deviations of the prior on a moving body."""


def target_of(grains: GrainSet, scan: Scan, settings: TrackSettings, backend: PatchBackend) -> Target:
    """The radiographs to fit, not yet filtered, with the bodies in their places and what of them is unknown."""
    bodies = grains.scene.bodies
    shift_sd, rotation_sd = BODY_SHIFT_SD * grains.voxel_size, BODY_ROTATION_SD
    still = NuisanceModel((NO_MOTION,) * len(bodies), False, shift_sd, rotation_sd)
    target = Target(
        scan, np.zeros(scan.line_integrals.shape, grains.precision), settings.projector, 0.0,
        derivatives=settings.derivatives, bodies=tuple(packed_body(body).on(backend) for body in bodies),
        nuisance=still, backend=backend,
    )  # fmt: skip
    target = target.with_fixed_bodies([k for k, body in enumerate(bodies) if not body.freedom.moves])
    return replace(target, nuisance=replace(still, freedoms=tuple(observable_freedom(body) for body in bodies)))


def observable_freedom(body: Body) -> Freedom:
    """The ways in which a body may move, without its rotation about an axis of symmetry, which no view shows.

    Free about it, a disc follows the noise of its own voxels: by 26° in a trial where it did not rotate.
    """
    axis = body.symmetry_axis if body.freedom.moves else None
    return body.freedom if axis is None else body.freedom.without_rotation_about(axis)
