"""One simulation of the radiographs at a pose, and what it leaves of the measured ones.

The residual is Eq. 22 of Khalili et al. (2017), weighted and filtered:

    r = F w (b − m(P)),

with b the measured line integrals, P those of the moved grains and bodies, m the detector's response (gain,
offset, trend, beam hardening), w the square root of each pixel's weight and F a Gaussian filter on each radiograph.
Derivatives are weighted and filtered as the residual is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.backends.base import BackendArray, PatchBackend
from grainmotion.model.detector_response import Response
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.objective import nuisance_motions
from grainmotion.objective.data_term import Target
from grainmotion.objective.global_parameters import Columns, dot
from grainmotion.objective.nuisance_motions import BodyImages
from grainmotion.objective.response_parameters import fit_response, power_images
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, difference_patches, differentiate_in_place, project_in_place
from grainmotion.projection.jacobian import PatchJacobian

MIN_SLOPE = 0.1
"""Least derivative of the detector's response by which a residual is divided."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Simulated and measured radiographs at a pose, without derivatives.

    ``values (pixels,)`` are each grain's own line integrals in its ``patches``, in the memory of the grains' backend.
    Images are ``(views, rows, columns)``: ``residual`` r, ``simulated`` F w m(P), ``line_integrals`` P of all grains
    and bodies, ``background`` that of bodies and liquid alone, and ``raw_residual`` b − m(P), neither weighted nor
    filtered and 0 where a pixel does not count.  ``response`` is the best one at this pose, ``response_columns`` are
    the images of its eliminated unknowns, those of a liquid last; ``fluid_step`` are the best values of these.
    """

    patches: Patches
    values: BackendArray
    residual: Image
    simulated: Image
    line_integrals: Image
    background: Image
    raw_residual: Image
    response: Response
    response_columns: Columns
    fluid_step: Float

    @property
    def cost(self) -> float:
        """½‖r‖²."""
        return 0.5 * dot(self.residual, self.residual)

    @property
    def left_path(self) -> Image:
        """Line integrals that the radiographs hold beside those that are simulated, as a perfect detector shows them.

        Where the response hardly rises, noise is no line integral.
        """
        return self.raw_residual / np.maximum(self.response.derivative(self.line_integrals), MIN_SLOPE)

    def grain_pixels(self, *images: Image, part: range | None = None) -> Iterator[tuple[int, Float, list[Image]]]:
        """Of each patch: the grain, its own line integrals in double precision, and those pixels of some images.

        ``part`` are the patches that are wanted, by default all.
        """
        for p in range(len(self.patches.boxes)) if part is None else part:
            grain, view, r0, r1, c0, c1 = self.patches.boxes[p]
            own = self.values[self.patches.offsets[p] : self.patches.offsets[p + 1]].astype(float)
            yield grain, own, [image[view, r0:r1, c0:c1].ravel() for image in images]


@dataclass(frozen=True, eq=False)
class LinearizedEvaluation(Evaluation):
    """An evaluation with derivatives of F w m(P).

    ``jacobian`` is by the grains' (u, δ), and of P itself if it is not filtered yet; ``nuisance_columns`` are by the
    unknowns of the nuisance motions.
    """

    jacobian: PatchJacobian
    nuisance_columns: Columns


def evaluate(grains: GrainArrays, target: Target, pose: Pose) -> Evaluation:
    """Simulate and compare at a pose."""
    geometry = nuisance_motions.corrected_geometry(target.scan.geometry, pose.nuisance)
    patches = footprint_patches(grains, pose, geometry)
    values = project_in_place(grains, pose, geometry, patches, target.projector)
    return _compare(target, pose, geometry, patches, values, grains.backend)[0]


def evaluate_with_derivatives(
    grains: GrainArrays, target: Target, pose: Pose, *, filtered: bool = True
) -> LinearizedEvaluation:
    """Simulate, compare and differentiate at a pose; the jacobian is of P itself unless it is ``filtered``."""
    geometry = nuisance_motions.corrected_geometry(target.scan.geometry, pose.nuisance)
    patches = footprint_patches(grains, pose, geometry, margin=len(target.kernel) - 1 if filtered else 0)
    differentiate = differentiate_in_place if target.derivatives == "analytic" else difference_patches
    values, jacobian = differentiate(grains, pose, geometry, patches, target.projector)
    evaluation, bodies = _compare(target, pose, geometry, patches, values, jacobian.backend)
    columns = _nuisance_columns(grains, target, pose, evaluation, jacobian, bodies)
    if filtered:
        jacobian.filter(target.root_weights * evaluation.response.derivative(evaluation.line_integrals), target.kernel)
    return LinearizedEvaluation(**vars(evaluation), jacobian=jacobian, nuisance_columns=columns)


def _compare(
    target: Target, pose: Pose, geometry: Geometry, patches: Patches, values: BackendArray, backend: PatchBackend
) -> tuple[Evaluation, BodyImages]:
    """The evaluation, and the images of the bodies with their derivatives where they are unknown."""
    images = nuisance_motions.body_images(
        target.bodies, target.nuisance, pose.nuisance, (geometry, target.projector), target.fixed_background
    )
    background = images.path if target.fluid is None else images.path + target.fluid
    path = assemble(values, patches, geometry, backend) + background
    response, simulated, columns, fluid_step = _best_response(target, path)
    fluid_step = fluid_step / response.gain if response.gain > 0 else 0 * fluid_step
    for step, column in zip(fluid_step, target.fluid_columns, strict=False):
        path = path + target.precision.type(step) * column
    raw = (target.scan.line_integrals.astype(target.precision) - response.apply(path)) * target.valid
    residual = target.measured - simulated
    evaluation = Evaluation(patches, values, residual, simulated, path, background, raw, response, columns, fluid_step)
    return evaluation, images


def _nuisance_columns(
    grains: GrainArrays, target: Target, pose: Pose, evaluation: Evaluation, jacobian: PatchJacobian, bodies: BodyImages
) -> Columns:
    """Derivatives by the nuisance motions, from those of P by the grains' motions and by the bodies'."""
    nuisance = target.nuisance
    response_derivative = evaluation.response.derivative(evaluation.line_integrals)
    columns = Columns()
    if nuisance.views:
        images = nuisance_motions.view_derivatives(evaluation.line_integrals, jacobian, grains, pose)
        for _, x, y, derivatives in bodies.derivatives:
            images[2] = images[2] + nuisance_motions.derivative_by_view_angle(x, y, derivatives)
        for image in images:
            columns.add(target.filtered(response_derivative * image), shared=False)
    for k, _, _, derivatives in bodies.derivatives:
        for way in nuisance.freedoms[k].ways if nuisance.freedoms else ():
            image = sum((w * d for w, d in zip(way, derivatives, strict=True) if w), np.zeros_like(derivatives[0]))
            columns.add(target.filtered(response_derivative * image), shared=True)
    return columns


def _best_response(target: Target, path: Image) -> tuple[Response, Image, Columns, Float]:
    """The response that fits best at line integrals P, F w m(P), the images of the eliminated unknowns, and the
    coefficients of a liquid's.

    While its polynomial is not monotone, its degree is lowered; at last the gain is fixed.
    """
    plain = target.filtered(path)
    model, views = target.response_model, len(path)
    while True:
        columns = Columns()
        for k, (power, shared) in enumerate(power_images(model, path)):
            first = k == 0 and model.gain != "none"
            columns.add(plain if first else target.filtered(power), shared)
        columns = columns + target.trends + target.filtered_fluid_columns
        response, more, fluid_step = fit_response(model, columns, target.measured - plain, views)
        if response.is_monotone(float(path.max(initial=0.0))) or (model.gain == "none" and model.degree == 1):
            return response, plain + more, columns, fluid_step
        lower = replace(model, degree=model.degree - 1)
        model = lower if model.degree > 1 else model.without_gain
