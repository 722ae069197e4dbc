"""Ellipsoids beside the grains of a fit: fixed images that are fitted again once the grains are in their places.

An ellipsoid is not the shape of a grain.  What it leaves of the shadow is the same in one place of a radiograph, so
that grains behind it would follow; its shadow therefore counts less, by how much more than elsewhere it leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._typing import Image
from grainmotion.model.pose import Pose
from grainmotion.model.state_fit import NewGrain
from grainmotion.objective.data_term import Target
from grainmotion.objective.evaluation import Evaluation
from grainmotion.objective.residual import StateProblem
from grainmotion.solvers.gauss_newton import Solution, gauss_newton
from grainmotion.tracking.ellipsoids import Ellipsoid, ellipsoid_images, fit_ellipsoids
from grainmotion.tracking.leftover import usual_of
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.uncertainty.noise_model import shaded_pixels

ALTERNATIONS = 3
"""Times that ellipsoids are fitted beside the grains, and the grains beside them."""
CORRELATION = 10.0
"""Pixels over which what an ellipsoid leaves is correlated."""
RIM_PIXELS = 3
"""How far what it leaves reaches beyond its shadow."""


def with_ellipsoids(fit: MultistageFit, found: Sequence[Ellipsoid], sign: int = 1) -> MultistageFit:
    """A copy of a fit with ellipsoids beside its grains, or without them with ``sign`` −1."""
    other = replace(fit, levels={})
    add_ellipsoids(other, found, sign)
    return other


def add_ellipsoids(fit: MultistageFit, found: Sequence[Ellipsoid], sign: int = 1) -> None:
    """Add the images of ellipsoids to what a fit keeps fixed; take them off with ``sign`` −1."""
    if found:
        image = (sign * ellipsoid_images(found, fit.target.scan.geometry)).astype(fit.target.precision)
        fit.target = replace(fit.target, fixed_background=fit.target.fixed_background + image)
        fit.levels.clear()


def refitted_beside(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose], found: Sequence[Ellipsoid]
) -> tuple[StateProblem, Solution[Pose], tuple[Ellipsoid, ...]]:
    """Ellipsoids and grains fitted beside each other, in turn."""
    if not found:
        return problem, solution, ()
    usual, geometry = usual_of(fit), fit.target.scan.geometry
    for _ in range(ALTERNATIONS):
        evaluation = replace(problem, target=replace(problem.target, sigma=0.0, weights=None)).evaluate(solution.state)
        gain = max(evaluation.response.gain, 0.5)
        left = evaluation.raw_residual / gain + ellipsoid_images(found, geometry) * fit.target.valid
        more = fit_ellipsoids(left, geometry, found, usual, fit.target.valid)
        add_ellipsoids(fit, found, -1)
        add_ellipsoids(fit, more)
        found = more
        problem, solution = fit.solve_free(solution.state, "beside new grains", fit.settings.filters[-1:])
    return problem, solution, tuple(found)


def with_ellipsoids_discounted(
    fit: MultistageFit, problem: StateProblem, solution: Solution[Pose], found: Sequence[Ellipsoid]
) -> tuple[StateProblem, Solution[Pose]]:
    """The problem and its solution with less weight in the shadows of ellipsoids."""
    if not found:
        return problem, solution
    target = problem.target
    discount = shadow_discount(target, problem.evaluate(solution.state), found)
    problem = replace(problem, target=replace(target, discount=discount))
    observe = fit.observer(problem.target, "shadows of new grains discounted")
    return problem, gauss_newton(problem, solution.state, fit.fine_stopping(), observe)


def shadow_discount(target: Target, evaluation: Evaluation, found: Sequence[Ellipsoid]) -> Image:
    """The discount of pixels ``(views, rows, columns)``, of the target and in the shadows of ellipsoids."""
    geometry, squares = target.scan.geometry, evaluation.raw_residual.astype(float) ** 2
    shadows = [_widened(ellipsoid_images([one], geometry) > 0) for one in found]
    shaded = shaded_pixels(target, evaluation)
    outside = shaded & ~np.any(shadows, axis=0)
    even = float(squares[outside if outside.any() else shaded].mean())
    discount = np.ones(squares.shape)
    for shadow in shadows:
        inside = shadow & (target.valid > 0)
        excess = max(float(squares[inside].mean()) - even, 0.0) if inside.any() else 0.0
        discount[shadow] = np.minimum(discount[shadow], 1 / (1 + CORRELATION * excess / max(even, 1e-30)))
    if target.discount is not None:
        discount *= target.discount
    return discount.astype(target.precision)


def _widened(shadow: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A shadow and its rim, view by view."""
    cross = ndimage.generate_binary_structure(2, 1)
    return np.stack([ndimage.binary_dilation(view, cross, RIM_PIXELS) for view in shadow])


def new_grains(found: Sequence[Ellipsoid]) -> tuple[NewGrain, ...]:
    """What is told of them, from the highest to the lowest."""
    order = sorted(found, key=lambda one: -one.center[2])
    return tuple(NewGrain(e.center, e.center_sd, e.radius, e.radius_sd, e.attenuation) for e in order)
