"""Settings of a reconstruction."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from grainmotion._typing import Projector
from grainmotion._validation import validated
from grainmotion.backends.device import DeviceName

MIN_ACCELERATED_VIEWS = 240
"""Views from which on the accelerated method is much cheaper; with fewer, it uses each view several times."""

Method = Literal["auto", "accelerated", "sart"]
Outline = Annotated[float, Field(gt=0)] | Literal["auto", "grid"]
"""Radius of the sample's outline about the grid's axis, mm; found from the radiographs; or the grid stays as it is."""


@validated
class ReconstructSettings:
    """How to reconstruct the reference.

    Examples
    --------
    >>> gm.ReconstructSettings(sweeps=3).sweeps
    3
    >>> gm.ReconstructSettings(method="sart").plain(views=90)
    True
    """

    projector: Annotated[Projector, Field(description="operator shared by reconstruction and tracking")] = "trilinear"
    method: Annotated[
        Method,
        Field(
            description="plain SART, view by view; accelerated: subsets of views with momentum, from a coarse start, "
            "which comes as near in a third of the time; auto: accelerated from 240 views on, unless an option of "
            "plain SART is given"
        ),
    ] = "auto"
    sweeps: Annotated[
        int | None, Field(ge=1, description="most sweeps over all views of plain SART; 6 unless given")
    ] = None
    relaxation: Annotated[
        float | None, Field(gt=0, lt=2, description="λ of plain SART's first sweep; 1 unless given")
    ] = None
    decay: Annotated[
        float | None, Field(gt=0, le=1, description="factor on λ after each sweep of plain SART; 0.5 unless given")
    ] = None
    tolerance: Annotated[
        float | None,
        Field(ge=0, description="stop plain SART once a sweep lowers ε by less than this share; 0.02 unless given"),
    ] = None
    noise: Annotated[
        float | None,
        Field(gt=0, description="stop plain SART once ε reaches this relative noise, 1/SNR (discrepancy principle)"),
    ] = None
    non_negative: Annotated[bool, Field(description="keep attenuation at or above zero")] = True
    circular: Annotated[bool, Field(description="reconstruct inside the grid's upright inscribed cylinder only")] = True
    outline: Annotated[
        Outline,
        Field(
            description="radius of the upright cylinder that holds the sample, mm: the grid is grown to hold it and "
            'all rays through it; "auto" finds it from the radiographs; "grid" keeps the grid; [volume] outline sets '
            "it as well"
        ),
    ] = "auto"
    hardening: Annotated[
        Literal["auto", False],
        Field(
            description='"auto": where radiographs contradict each other by what beam hardening explains, linearise '
            "them, and those of all states; false: use them as they are; [calibrate] hardening fits another curve "
            "instead"
        ),
    ] = "auto"
    device: Annotated[
        DeviceName, Field(description="where rays are traced: CPU, NVIDIA GPU, or the GPU if there is one")
    ] = "auto"

    @model_validator(mode="after")
    def _check_options(self) -> ReconstructSettings:
        given = [n for n in ("sweeps", "relaxation", "decay", "tolerance", "noise") if getattr(self, n) is not None]
        if given and self.method == "accelerated":
            raise ValueError(f'{", ".join(given)}: only plain SART takes this; set method = "sart", or leave it out')
        return self

    def plain(self, views: int) -> bool:
        """Whether a scan is reconstructed by plain SART.

        Parameters
        ----------
        views : int
            Number of its views.

        Returns
        -------
        bool
            False for the accelerated method.
        """
        given = (self.sweeps, self.relaxation, self.decay, self.tolerance, self.noise)
        if self.method == "auto":
            return views < MIN_ACCELERATED_VIEWS or any(value is not None for value in given)
        return self.method == "sart"
