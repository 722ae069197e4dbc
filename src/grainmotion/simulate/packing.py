"""Packing: particles dropped one by one into a cylinder, settling until they can go no lower.

Every particle falls from above in several random poses, the lowest is kept, and it then slides and
rolls: small random moves are taken whenever they lower its centre without overlap, with steps that
shrink as they fail.  A particle ends up resting on several neighbours with gaps of about a
thousandth of its size.  Afterwards all particles settle again in turn.  Overlap is tested by the
surface points of each of two neighbours against the triangles of the other, so nothing is assumed of
the shapes but that they are star-shaped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from grainmotion._typing import Float, Progress
from grainmotion._validation import validated
from grainmotion.errors import InputError
from grainmotion.kernels import packing
from grainmotion.simulate.packing_arrays import Poses, Rules, stack
from grainmotion.simulate.sample import Particle, Sample
from grainmotion.simulate.signed_distance import locator


@validated
class PackingSettings:
    """How to pack."""

    radius: Annotated[float, Field(gt=0, description="inner radius of the cylinder, mm")]
    gap: Annotated[
        float, Field(ge=0, lt=0.1, description="least distance between surfaces, over a particle's size")
    ] = 1e-3
    drops: Annotated[int, Field(ge=1, description="random poses from which each particle falls")] = 6
    moves: Annotated[int, Field(ge=0, description="most random moves while a particle settles")] = 1500
    sweeps: Annotated[int, Field(ge=0, description="times that all settle again once the last one lies")] = 2


def pack(
    particles: Sequence[Particle], settings: PackingSettings, seed: int, progress: Progress | None = None
) -> Sample:
    """Drop particles into an upright cylinder about the z axis, in order, and let them settle.

    Parameters
    ----------
    particles : sequence of Particle
        Where they lie does not matter.
    settings : PackingSettings
    seed : int
        The same seed gives the same packing.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Sample
        The particles in their places, the heap's mid-height at z = 0.

    Raises
    ------
    InputError
        If a particle does not fit in the cylinder.
    """
    if not particles:
        raise InputError("particles", "there are none", "give at least one")
    rng = np.random.default_rng(seed)
    located, origins = zip(*(locator(p.shape) for p in particles), strict=True)
    bodies = stack(list(located))
    size = 2 * float(np.mean(bodies.radii))
    if bodies.radii.max() >= settings.radius:
        raise InputError(
            "packing radius",
            f"{settings.radius} mm is not wider than a particle of radius {bodies.radii.max():.3g} mm",
            "give a wider cylinder or smaller particles",
        )
    n = len(particles)
    poses = Poses(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))
    rules = Rules(settings.radius, settings.gap * size, size)
    for i in range(n):
        packing.drop(i, poses, bodies, rules, settings.drops, rng)
        packing.settle(i, i + 1, poses, bodies, rules, settings.moves, rng)
        if progress:
            progress("packing", i + 1, n)
    for _ in range(settings.sweeps):
        for i in np.argsort(poses.positions[:, 2]):
            packing.settle(i, n, poses, bodies, rules, settings.moves, rng)
    for _ in range(2):  # what the last moves took the ground from
        for i in np.argsort(poses.positions[:, 2]):
            x, t = poses.positions[i], poses.turns[i]
            poses.positions[i, 2] = packing.fall(i, n, x, t, poses, bodies, rules)
    heights = np.concatenate([b.vertices @ t[2] + x[2] for b, x, t in zip(located, *poses, strict=True)])
    centre = np.array([0.0, 0.0, (heights.min() + heights.max()) / 2])
    return Sample(
        tuple(
            p.moved(turn, position - turn @ origin - centre)
            for p, origin, position, turn in zip(particles, origins, *poses, strict=True)
        )
    )


def gaps(sample: Sample, reach: float | None = None) -> Float:
    """Least distance between the surfaces of each two particles ``(n, n)``, mm; negative where they overlap.

    Measured from surface points of one to the triangles of the other, up to ``reach`` (mm, by
    default a fiftieth of the largest radius); infinite beyond.
    """
    located, origins = zip(*(locator(p.shape) for p in sample.particles), strict=True)
    bodies = stack(list(located))
    n = len(sample)
    poses = Poses(np.array(origins), np.tile(np.eye(3), (n, 1, 1)))
    out = np.full((n, n), np.inf)
    packing.all_gaps(poses, bodies, float(bodies.radii.max()) / 50 if reach is None else reach, out)
    return np.minimum(out, out.T)
