"""Settings of all that is derived from a reference scan: calibration, reconstruction, segmentation."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from grainmotion._validation import validated
from grainmotion.calibration.calibrate import MIN_CALIBRATION_VIEWS
from grainmotion.calibration.corrections import Parameter
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.segmentation.settings import SegmentSettings

MIN_AUTO_VIEWS = 60
"""Views from which "auto" calibrates the geometry of a full scan: halves of fewer contradict each other anyway."""


@validated
class ScannerSettings:
    """Corrections to estimate from the reference scan; all but the beam's level apply to all states as well.

    Examples
    --------
    >>> gm.ScannerSettings(geometry=False).geometry
    False
    """

    geometry: Annotated[
        bool | Literal["auto"] | list[Parameter],
        Field(
            description='"auto": estimate "shift_u", "turn" and "axis_tilt" and correct what is significant (a full '
            "scan of few views is left alone); true: correct all three; a list: estimate these, out of those and "
            '"axis_offset", "yaw", "pitch", "shift_v"; false: use the geometry as given'
        ),
    ] = "auto"
    beam_level: Annotated[
        Literal["auto", False],
        Field(
            description='"auto": where the beam is not as bright in a view of the reference as in the flats, correct '
            "it by a factor a view, from air where there is some, else estimated with a small reconstruction (a "
            "scan's `air` takes precedence); false: use the radiographs as they are"
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
        enough = self.geometry != "auto" or views >= MIN_AUTO_VIEWS
        return bool((self.geometry and enough) or self.hardening)

    def calibrates_geometry(self, views: int) -> bool:
        """Whether the geometry of a scan is calibrated.

        Parameters
        ----------
        views : int
            Number of its radiographs.

        Returns
        -------
        bool
            False under "auto" if they are too few for any correction.
        """
        return bool(self.geometry) and (self.geometry != "auto" or views >= MIN_CALIBRATION_VIEWS)


@validated
class ReferenceSettings:
    """How the reference state is made from its full scan: the tables of the experiment file of the same names.

    Examples
    --------
    >>> gm.ReferenceSettings(reconstruct=gm.ReconstructSettings(sweeps=4)).reconstruct.sweeps
    4
    """

    calibrate: Annotated[ScannerSettings, Field(description="which corrections to estimate")] = ScannerSettings()
    reconstruct: Annotated[ReconstructSettings, Field(description="how to reconstruct")] = ReconstructSettings()
    segment: Annotated[SegmentSettings, Field(description="how to segment and extract grains")] = SegmentSettings()
