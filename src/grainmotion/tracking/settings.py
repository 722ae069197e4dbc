"""Settings of `track`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from grainmotion._typing import Projector
from grainmotion._validation import validated
from grainmotion.backends.device import DeviceName
from grainmotion.model.detector_response import Trend
from grainmotion.objective.data_term import Derivatives
from grainmotion.objective.response_parameters import Gain, ResponseModel
from grainmotion.uncertainty.noise_model import Loss, Weights

Corrections = Literal["never", "auto", "always"]


def _named(on: str, off: str) -> BeforeValidator:
    """Accept true and false for the names of two options."""
    return BeforeValidator(lambda value: {True: on, False: off}[value] if isinstance(value, bool) else value)


@validated
class TrackSettings:
    """How to track.

    Examples
    --------
    >>> gm.TrackSettings(strain=True, max_sd_voxel=0.1).max_sd_voxel
    0.1
    """

    projector: Annotated[
        Projector, Field(description="operator; in an experiment file the reconstruction's own unless given")
    ] = "trilinear"
    derivatives: Annotated[Derivatives, Field(description="exact ones, or finite differences as in the paper")] = (
        "analytic"
    )
    filters: Annotated[
        tuple[Annotated[float, Field(ge=0)], ...],
        Field(
            min_length=1, description="Gaussian widths of the free stages in turn, pixels, for grains 45 pixels across"
        ),
    ] = (6.0, 2.0, 0.7)
    field_filter: Annotated[float, Field(ge=0, description="the same for the stages of one body and smooth field")] = (
        12.0
    )
    fields: Annotated[
        bool, Field(description="begin with one body and a smooth field; off: all grains free at once")
    ] = True
    search: Annotated[
        bool, Field(description="search widely for grains that fit badly, leave out grains that are not there")
    ] = True
    alternatives: Annotated[
        bool,
        Field(description="try other poses of grains that look alike in several; what fits as well makes it ambiguous"),
    ] = True
    strain: Annotated[
        bool,
        Field(description="measure the strain of each grain beside its motion, for soft grains; twelve unknowns each"),
    ] = False
    strain_sd: Annotated[
        float, Field(gt=0, description="standard deviation of strains to expect: fixes those that views do not show")
    ] = 0.1
    gain: Annotated[
        Gain,
        _named(on="global", off="none"),
        Field(description="gain and offset (a, b of Eq. 22) to eliminate: none, one for all views, one a view"),
    ] = "global"
    trend: Annotated[
        Trend, Field(description='polynomial background to eliminate in each view; "constant" is a beam that drifts')
    ] = "constant"
    hardening: Annotated[
        Annotated[int, Field(ge=1, le=4)] | Literal["auto"],
        Field(
            description='degree of a polynomial of the line integral fitted for beam hardening; "auto" is 2 where the '
            "state shows it, else 1"
        ),
    ] = "auto"
    weights: Annotated[
        Weights, Field(description="of pixels: all alike, or by the estimated photon noise and model error")
    ] = "uniform"
    loss: Annotated[
        Loss, Field(description="least squares, Huber's loss against outliers, or the likelihood of Poisson counts")
    ] = "squares"
    view_corrections: Annotated[
        Corrections,
        _named(on="always", off="never"),
        Field(
            description="estimate each view's own panel shift and stage angle: always, never, or once the views "
            "contradict each other; refused with a sentence where the views cannot determine them"
        ),
    ] = "auto"
    iterations: Annotated[int, Field(ge=1, description="most iterations a stage")] = 30
    tolerance: Annotated[
        float, Field(gt=0, description="a stage ends once no grain's surface moves further, voxels")
    ] = 2e-3
    max_sd_voxel: Annotated[
        float, Field(gt=0, description="a grain is poorly determined above this sd of u, voxels")
    ] = 0.5
    max_sd_deg: Annotated[
        float, Field(gt=0, description="a grain is poorly determined above this sd of ω, degrees")
    ] = 5.0

    device: Annotated[
        DeviceName, Field(description="where kernels run: the processor, an NVIDIA GPU, or the GPU if there is one")
    ] = "auto"

    @property
    def response_model(self) -> ResponseModel:
        """Which numbers of the detector's response are unknown."""
        degree = 1 if self.hardening == "auto" else self.hardening
        return ResponseModel(self.gain, self.trend, degree)


PAPER = TrackSettings(
    projector="exact",
    derivatives="differences",
    filters=(0.0,),
    fields=False,
    search=False,
    alternatives=False,
    gain="none",
    trend="none",
    view_corrections="never",
    iterations=200,
)
"""The variant of Khalili et al. (2017): Siddon's path, finite differences, no filter, no stages."""
