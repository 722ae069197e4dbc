"""ScannerFile: what a scanner's own file tells about a scan, in the package's frame and units.

A reader of a format turns one file into a `ScannerFile`.  It converts units and signs, so that nothing after it knows
the format: lengths in mm, angles in degrees, the frame and the sense of rotation of `grainmotion.model.geometry`.
A number that the file does not hold stays None, and the experiment file has to give it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

from grainmotion._typing import Beam, Float, Kind
from grainmotion.model.finding import Finding
from grainmotion.model.geometry import Geometry


@dataclass(frozen=True, eq=False)
class CircleNumbers:
    """Numbers of a circular scan, with the names, units and signs of ``[reference.geometry]``; None where unknown.

    Attributes
    ----------
    beam : {"cone", "parallel"}
        Kind of beam.
    source_to_axis, source_to_detector, pixel_size, axis_offset : float
        mm.
    detector_offset : (float, float)
        Of the panel's centre along u and along v, mm; see `grainmotion.model.detector_alignment.DetectorAlignment`.
    detector_tilts_deg : (float, float, float)
        Of the panel about x, y, z at θ = 0, degrees.
    axis_tilt_deg : (float, float)
        Of the rotation axis about x and y at θ = 0, degrees.
    first_row : {"top", "bottom"}
        Where row 0 of the images lies.
    angles_deg : (n,) array
        Angle of each radiograph; source and panel turn counter-clockwise seen from above as it grows, which is the
        sample on its stage turning clockwise.
    """

    beam: Beam | None = None
    source_to_axis: float | None = None
    source_to_detector: float | None = None
    pixel_size: float | None = None
    detector_offset: tuple[float, float] | None = None
    detector_tilts_deg: tuple[float, float, float] | None = None
    axis_offset: float | None = None
    axis_tilt_deg: tuple[float, float] | None = None
    first_row: Literal["top", "bottom"] | None = None
    angles_deg: Float | None = None

    @property
    def known(self) -> dict[str, object]:
        """The numbers that the file tells but the angles, by their names."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "angles_deg"}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True, eq=False)
class ScannerFile:
    """What a scanner's file tells about a scan.

    Attributes
    ----------
    path : Path
        The file.
    format : str
        Its format, in words for messages: "Nikon .xtekct".
    circle : CircleNumbers
        Numbers of a circular scan.
    views : Geometry, optional
        Whole positions of source and panel in each view, of formats that hold them, instead of a circle.
    radiographs, flats, darks : tuple of str
        Where the images are: absolute paths, patterns or ``"file.h5::/path"``, as `grainmotion.io.stacks.find_stack`
        understands; empty where the file does not say or they are not there.  Patterns escape magic characters of
        folders (`glob.escape`).
    kind : {"counts", "transmission", "line-integrals"}, optional
        What the pixels are.
    white_level : float, optional
        Count of the open beam in radiographs that the scanner has already divided by its flats.
    mirrored : bool
        Whether column 0 lies on the other side: images have to be seen from behind.
    image_shifts : (n, 2) array, optional
        Features of each view lie so many columns and rows (pixels) further than the circle or ``views`` say.
    beam_levels : (n,) array, optional
        Intensity of the open beam in each view over that in the flats.
    axis_to_detector : float, optional
        mm, of files that tell it without the place of the source.
    unclear : tuple of (str, str)
        Keys of the circle that the file holds in a way that cannot be used, and why: they have to be given.
    facts : tuple of (str, str)
        What else a user wants to see of the file, label and text: voltage, date, sample.
    findings : tuple of Finding
        What is unusual, or was assumed.
    """

    path: Path
    format: str
    circle: CircleNumbers = field(default_factory=CircleNumbers)
    views: Geometry | None = None
    radiographs: tuple[str, ...] = ()
    flats: tuple[str, ...] = ()
    darks: tuple[str, ...] = ()
    kind: Kind | None = None
    white_level: float | None = None
    mirrored: bool = False
    image_shifts: Float | None = None
    beam_levels: Float | None = None
    axis_to_detector: float | None = None
    unclear: tuple[tuple[str, str], ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    findings: tuple[Finding, ...] = ()

    def placed(self, geometry: Geometry) -> Geometry:
        """Views of this scan with the images mirrored and shifted as this file tells; as many views as it has."""
        vectors = geometry.vectors.copy()
        if self.mirrored:
            vectors[:, 6:9] *= -1
        if self.image_shifts is not None and len(self.image_shifts) == len(geometry):
            columns, rows = self.image_shifts[:, :1], self.image_shifts[:, 1:]
            vectors[:, 3:6] -= columns * vectors[:, 6:9] + rows * vectors[:, 9:]
        return Geometry(vectors, geometry.shape, geometry.beam)
