"""What is made of a reference scan, and how: calibration of the scanner, reconstruction, segmentation."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from grainmotion._validation import validated
from grainmotion.calibration.calibrate import FEWEST_VIEWS
from grainmotion.calibration.corrections import Parameter
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.segmentation.settings import SegmentSettings

MIN_VIEWS_UNASKED = 60
"""Views of a full scan from which "auto" calibrates its geometry: half of fewer contradicts the other half anyway."""


@validated
class ScannerSettings:
    """What the reference scan is asked about the scanner, for the reference and all states."""

    geometry: Annotated[
        bool | Literal["auto"] | list[Parameter],
        Field(
            description='"auto": find "shift_u", "turn" and "axis_tilt" and correct what is clearly off (a full scan '
            "of few views is left alone); true: correct them whatever they are; a list: find these, out of those and "
            '"axis_offset", "yaw", "pitch", "shift_v"; false: take the geometry as told'
        ),
    ] = "auto"
    hardening: Annotated[
        Literal[0, 2, 3, 4], Field(description="degree of the curve that undoes beam hardening; 0 to leave it")
    ] = 0

    def calibrates(self, views: int) -> bool:
        """Whether a scan is calibrated at all.

        Parameters
        ----------
        views : int
            Number of its radiographs.

        Returns
        -------
        bool
            False under "auto" if half of the views could not be checked against the other half.
        """
        enough = self.geometry != "auto" or views >= MIN_VIEWS_UNASKED
        return bool((self.geometry and enough) or self.hardening)

    def calibrates_geometry(self, views: int) -> bool:
        """Whether a scan that is calibrated is asked about its geometry, not about its beam alone.

        Parameters
        ----------
        views : int
            Number of its radiographs.

        Returns
        -------
        bool
            False under "auto" if they are too few for any correction.
        """
        return bool(self.geometry) and (self.geometry != "auto" or views >= FEWEST_VIEWS)


@validated
class ReferenceSettings:
    """How the reference state is made from its full scan: the tables of the experiment file of the same names."""

    calibrate: Annotated[ScannerSettings, Field(description="what to ask about the scanner")] = ScannerSettings()
    reconstruct: Annotated[ReconstructSettings, Field(description="how to reconstruct")] = ReconstructSettings()
    segment: Annotated[SegmentSettings, Field(description="how to segment and extract grains")] = SegmentSettings()
