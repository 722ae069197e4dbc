"""What radiographs hold beside the grains that are there, taken apart into ellipsoids of about a grain's size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float, Image
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.objective.response_parameters import IDENTITY_RESPONSE
from grainmotion.tracking.ellipsoids import (
    Ellipsoid,
    Usual,
    ellipsoid_images,
    fit_ellipsoids,
    model_variance,
    unlikeliness,
)
from grainmotion.tracking.multiresolution import coarsened
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.presence import Census, scaled
from grainmotion.tracking.unexplained import grid_around, least_over_views

MIN_SHARE = 0.45
"""Unexplained line integrals, over those of a usual grain under the same filter, from which an ellipsoid is tried."""
MAX_ELLIPSOIDS, MIN_LIMIT = 30, 6
"""Ellipsoids at most; fewer where there are fewer grains, but never less than the second.  Where more seem to be there,
it is no grains that the radiographs hold: evenly grey ones took as many as were allowed, and minutes."""
RADIUS_PIXELS = 5.0
"""Least radius of a grain in coarse pixels."""
MIN_MASS = 0.35
"""Mass over a usual one below which an ellipsoid is dropped."""
MAX_USUAL_GRAINS = 1000
"""Grains from which the usual radius and attenuation are taken, at most."""
MAX_REACH_RADII = 60.0
"""Half the width of a sample in which new grains are sought, in grain radii."""
HALF_WAY = 0.8
"""Where two are tried in place of one: so many usual radii from its centre, on either side along its longest axis."""
MAX_SPLIT_COST, MIN_EVIDENCE, MIN_SPLIT_MASS = 0.85, 10.0, 1.3
"""Cost of two over that of one up to which there are two, the least by which it falls, and the mass of one, over a
usual one, from which two are tried: 0.35 to 0.75 where two stones touch, 0.92 where one is cut in two."""


def usual_of(fit: MultistageFit, spread: float = 0.3) -> Usual:
    """Medians of the grains of a fit; the radius is that of a ball of the median mass."""
    grains = fit.grains
    images = [grains.voxels_of(row) for row in range(0, len(grains), -(-len(grains) // MAX_USUAL_GRAINS))]
    masses = [float(image.sum(dtype=float)) for image in images]
    inside = np.concatenate([image[image > 0] for image in images])
    attenuation = float(np.median(inside)) if len(inside) else 0.0
    if not (attenuation > 0 and np.median(masses) > 0):
        return Usual(0.0, 0.0, spread)
    radius = grains.voxel_size * float(np.cbrt(3 * np.median(masses) / (4 * np.pi * attenuation)))
    return Usual(radius, attenuation, spread)


def beside_census(fit: MultistageFit, census: Census, spread: float) -> tuple[Ellipsoid, ...]:
    """Ellipsoids in what a census leaves; radius and attenuation are expected within ``spread`` of the usual ones."""
    scaled_fit = replace(fit, grains=scaled(fit.grains, np.minimum(census.amplitudes, 1.0)), levels={})
    return beside_pose(scaled_fit, census.pose, spread)


def beside_pose(
    fit: MultistageFit, pose: Pose, spread: float, known: tuple[Ellipsoid, ...] = ()
) -> tuple[Ellipsoid, ...]:
    """Ellipsoids in what the grains of a fit leave at a pose, from those ``known`` already."""
    usual, target = usual_of(fit, spread), fit.target
    # a single grain may have been carried far off
    places = fit.grains.centers + np.median(pose.translations, axis=0)
    reach = max(float(np.abs(places - places.mean(axis=0)).max()), usual.radius) if len(places) else np.inf
    if not 0 < usual.radius < np.inf or not reach < MAX_REACH_RADII * usual.radius:
        return known
    evaluation = StateProblem(fit.grains, replace(target, sigma=0.0, response_model=IDENTITY_RESPONSE)).evaluate(pose)
    factor = max(1, int(usual.radius / target.scan.geometry.pixel_at(fit.grains.centers.mean(axis=0)) / RADIUS_PIXELS))
    coarse = coarsened(replace(target, scan=replace(target.scan, line_integrals=evaluation.raw_residual)), factor)
    left = Leftover(coarse.scan.line_integrals, coarse.scan.geometry, coarse.valid, usual, len(fit.grains))
    return tuple(left.ellipsoids(grid_around(places, usual.radius), known))


@dataclass(frozen=True, eq=False)
class Leftover:
    """What radiographs hold beside so many ``grains``: ``images (views, rows, columns)``, and what one is expected to
    be like.
    """

    images: Image
    geometry: Geometry
    valid: Image
    usual: Usual
    grains: int = MAX_ELLIPSOIDS

    def fitted(self, found: list[Ellipsoid], beside: Image | float = 0.0) -> list[Ellipsoid]:
        """Ellipsoids fitted together, beside a further image."""
        return fit_ellipsoids(self.images - beside, self.geometry, found, self.usual, self.valid)

    def beside(self, found: list[Ellipsoid]) -> Image:
        """What is left beside ellipsoids."""
        return self.images - self.valid * ellipsoid_images(found, self.geometry)

    def ellipsoids(self, grid: Float, known: tuple[Ellipsoid, ...] = ()) -> list[Ellipsoid]:
        """Ellipsoids one after the other, at those of the points ``grid (k, 3)`` where all views leave most.

        Those ``known`` alone if more than there were grains seem to be there.
        """
        middle, found = grid.mean(axis=0), self.fitted(list(known))
        found = [one for one in found if one.mass > MIN_MASS * self._ball(middle).mass]
        peak = float(
            least_over_views(
                ellipsoid_images([self._ball(middle)], self.geometry), self.geometry, middle[None], self.usual.radius
            )[0]
        )
        limit = max(self.grains, MIN_LIMIT)
        for _ in range(MAX_ELLIPSOIDS):
            if len(found) > limit:
                return list(known)
            least = least_over_views(self.beside(found), self.geometry, grid, self.usual.radius)
            best = int(np.argmax(least))
            if least[best] < MIN_SHARE * peak:
                split = self._split(found)
                if len(split) == len(found):
                    break
                found = split
                continue
            found = self.fitted([*found, self._ball(grid[best])])
        return found

    def _ball(self, place: Float) -> Ellipsoid:
        return Ellipsoid.ball(place, self.usual.radius, self.usual.attenuation)

    def _split(self, found: list[Ellipsoid]) -> list[Ellipsoid]:
        """With two in place of the one that two explain best, if they explain it better by more than chance."""
        best, choice = MAX_SPLIT_COST, found
        for k, one in enumerate(found):
            if one.mass < MIN_SPLIT_MASS * self._ball(one.center).mass:
                continue
            others = [*found[:k], *found[k + 1 :]]
            beside = self.valid * ellipsoid_images(others, self.geometry)
            box = ellipsoid_images([replace(one, axes=1.5 * one.axes)], self.geometry) > 0
            before = self._cost([one], beside, box)
            way = HALF_WAY * self.usual.radius * np.linalg.eigh(one.axes)[1][:, -1]
            two = self.fitted([self._ball(one.center + side * way) for side in (1, -1)], beside)
            after = self._cost(two, beside, box)
            if after < best * before and after < before - MIN_EVIDENCE:
                best, choice = after / before, [*others, *two]
        return choice if choice is found else self.fitted(choice)

    def _cost(self, some: list[Ellipsoid], beside: Image, box: NDArray[np.bool_]) -> float:
        """Squared residual of some ellipsoids in a part of the radiographs over its variance, and what is unlikely."""
        left = (self.images - beside - self.valid * ellipsoid_images(some, self.geometry))[box]
        variance = model_variance(self.geometry, self.usual, some[0].center)
        return float((left**2).sum()) / variance + sum(unlikeliness(one, self.usual) for one in some)
