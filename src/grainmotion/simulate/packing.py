"""Packing: particles dropped one by one into a cylinder, each settling until it can go no lower.

A particle falls from above in several random poses, of which the lowest final position is kept.  Then it slides and
rolls: a small random move is accepted if it lowers the centre without overlap, and steps shrink after rejected moves.
It ends up resting on several neighbours, with gaps of about a thousandth of its size.  Afterwards all particles
settle again in turn.  Two particles overlap where a surface point of one lies inside the other, so the only
assumption about shapes is that they are star-shaped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Progress
from grainmotion._validation import validated
from grainmotion.errors import InputError
from grainmotion.kernels import packing
from grainmotion.simulate.packing_arrays import Poses, Rules, stack
from grainmotion.simulate.sample import Particle, Sample
from grainmotion.simulate.signed_distance import locator


@validated
class PackingSettings:
    """Settings of `pack`.

    Examples
    --------
    >>> gm.simulate.PackingSettings(radius=3.0).radius
    3.0
    """

    radius: Annotated[float, Field(gt=0, description="inner radius of the cylinder, mm")]
    gap: Annotated[
        float, Field(ge=0, lt=0.1, description="least distance between surfaces, over a particle's size")
    ] = 1e-3
    drops: Annotated[int, Field(ge=1, description="random poses from which each particle falls")] = 6
    moves: Annotated[int, Field(ge=0, description="most random moves while a particle settles")] = 1500
    sweeps: Annotated[int, Field(ge=0, description="times that all particles settle again after the last one")] = 2


@checked_arguments
def pack(
    particles: Sequence[Particle], settings: PackingSettings, seed: int, progress: Progress | None = None
) -> Sample:
    """Drop particles into an upright cylinder about the z axis, in order, and let them settle.

    Parameters
    ----------
    particles : sequence of Particle
        At any position.
    settings : PackingSettings
        The cylinder, and how long to settle.
    seed : int
        The same seed gives the same packing.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Sample
        The packed particles, the mid-height of the heap at z = 0.

    Raises
    ------
    InputError
        If there are no particles, or one does not fit in the cylinder.

    Examples
    --------
    >>> stones = [gm.simulate.Particle(gm.simulate.stone(k, 2.0, 2), 0.1) for k in (3, 8)]
    >>> sample = gm.simulate.pack(stones, gm.simulate.PackingSettings(radius=2.5), seed=0)
    >>> len(sample.particles)
    2
    """
    if not particles:
        raise InputError("particles", "there are none", "give at least one")
    rng = np.random.default_rng(seed)
    located, origins = zip(*(locator(p.shape) for p in particles), strict=True)
    bodies = stack(list(located))
    size = 2 * float(np.mean(bodies.radii))
    if bodies.radii.max() >= settings.radius:
        fact = f"{settings.radius} mm is not wider than a particle of radius {bodies.radii.max():.3g} mm"
        raise InputError("packing radius", fact, "give a wider cylinder or smaller particles")
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
    for _ in range(2):  # particles whose support moved last fall once more
        for i in np.argsort(poses.positions[:, 2]):
            poses.positions[i, 2] = packing.fall(i, n, poses.positions[i], poses.rotations[i], poses, bodies, rules)
    heights = np.concatenate([b.vertices @ r[2] + x[2] for b, x, r in zip(located, *poses, strict=True)])
    centre = np.array([0.0, 0.0, (heights.min() + heights.max()) / 2])
    return Sample(
        tuple(
            p.moved(rotation, position - rotation @ origin - centre)
            for p, origin, position, rotation in zip(particles, origins, *poses, strict=True)
        )
    )


@checked_arguments
def gaps(sample: Sample, reach: float | None = None) -> Float:
    """Least distance between the surfaces of each pair of particles.

    Parameters
    ----------
    sample : Sample
        The particles.
    reach : float, optional
        Largest distance that is measured, mm; a fiftieth of the largest radius if None.

    Returns
    -------
    (n, n) array
        mm, from surface points of one particle to the triangles of the other.  Negative where they overlap, infinite
        beyond ``reach`` and on the diagonal.

    Examples
    --------
    >>> gm.simulate.gaps(case.sample).shape
    (4, 4)
    """
    located, origins = zip(*(locator(p.shape) for p in sample.particles), strict=True)
    bodies = stack(list(located))
    n = len(sample)
    poses = Poses(np.array(origins), np.tile(np.eye(3), (n, 1, 1)))
    out = np.full((n, n), np.inf)
    packing.all_gaps(poses, bodies, float(bodies.radii.max()) / 50 if reach is None else reach, out)
    return np.minimum(out, out.T)
