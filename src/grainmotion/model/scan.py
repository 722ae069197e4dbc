"""Scan: line integrals with their geometry; air normalisation; signal-to-noise ratio."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import check_argument, checked_arguments
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.precision import precision_of
from grainmotion.model.summary import Summarised, Summary, shape_text, size_text
from grainmotion.model.thumbnails import grey_picture


@dataclass(frozen=True, eq=False, repr=False)
class Scan(Summarised):
    """Radiographs as line integrals −ln((I − dark)/(flat − dark)), with the geometry of their views.

    Attributes
    ----------
    line_integrals : (views, rows, columns) float32 or float64 array
        Dimensionless; double precision is kept, anything else becomes float32.  Finite everywhere (repaired
        where ``valid`` is False).
    geometry : Geometry
        One view a radiograph.
    valid : (views, rows, columns) bool array, optional
        False where the pixel was dead, saturated or dark and must carry no weight; None if all are good.
    open_beam : (rows, columns) array, optional
        Flat minus dark over its own mean, in proportion to the photons of each pixel; None if uniform.

    Raises
    ------
    InputError
        If shapes disagree or a line integral is not finite.

    Examples
    --------
    >>> len(state), state.line_integrals.shape
    (4, (4, 96, 72))
    >>> len(state.select([0, 2]))
    2
    """

    line_integrals: NDArray[np.floating]
    geometry: Geometry
    valid: NDArray[np.bool_] | None = None
    open_beam: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        check_argument("Scan(geometry)", self.geometry, ["Geometry"])
        images = np.ascontiguousarray(self.line_integrals, dtype=precision_of(self.line_integrals))
        expected = (len(self.geometry), *self.geometry.shape)
        if images.shape != expected:
            raise InputError(
                "scan",
                f"radiographs {images.shape} do not match the geometry {expected} (views, rows, columns)",
                "give one geometry row a radiograph",
            )
        if not all(np.isfinite(image).all() for image in images):
            raise InputError("scan", "line integrals hold NaN or infinity", "repair or mask those pixels")
        if self.valid is not None and self.valid.shape != expected:
            raise InputError("scan", f"mask {self.valid.shape} does not match {expected}", "give one flag a pixel")
        if self.open_beam is not None and self.open_beam.shape != expected[1:]:
            raise InputError("scan", f"open beam {self.open_beam.shape} does not match {expected[1:]}", "give one flat")
        object.__setattr__(self, "line_integrals", images)

    def __len__(self) -> int:
        return len(self.geometry)

    def select(self, views: slice | list[int] | NDArray[np.int_]) -> Scan:
        """The scan of some views, in the given order.

        Parameters
        ----------
        views : slice, list of int or int array
            Views to keep.

        Returns
        -------
        Scan
            Their radiographs and geometry.
        """
        valid = None if self.valid is None else self.valid[views]
        return Scan(self.line_integrals[views], self.geometry[views], valid, self.open_beam)

    def levelled(self, levels: NDArray[np.floating]) -> Scan:
        """The scan with a number subtracted from the line integrals of each view.

        Parameters
        ----------
        levels : (views,) array
            Line integrals of what is to be zero, as of air.

        Returns
        -------
        Scan
            The corrected radiographs.
        """
        offsets = levels.astype(self.line_integrals.dtype)[:, None, None]
        return replace(self, line_integrals=self.line_integrals - offsets)

    def air_medians(self, air: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Median line integral of some pixels in each view; NaN where none of them is good.

        Parameters
        ----------
        air : (rows, columns) bool array
            The pixels.

        Returns
        -------
        (views,) array
            Dimensionless.
        """
        levels = np.full(len(self), np.nan)
        for view, image in enumerate(self.line_integrals):
            good = air if self.valid is None else air & self.valid[view]
            if good.any():
                levels[view] = np.median(image[good])
        return levels

    def _summary(self) -> Summary:
        geometry, images = self.geometry, self.line_integrals
        rows = [
            ("radiographs", f"{len(self)} of {shape_text(geometry.shape)} pixels, {geometry.beam} beam"),
            ("line integrals", f"{images.dtype}, {size_text(images.nbytes)}, dimensionless"),
            ("masked pixels", "none" if self.valid is None else "dead, saturated or dark ones, see valid"),
        ]
        upwards = float(geometry.v[0, 2]) >= 0
        return Summary("Scan", rows[0][1], tuple(rows), grey_picture(images[0], upwards=upwards))


def air_levels(
    scan: Scan, *, margin: int | None = None, region: tuple[int, int, int, int] | None = None
) -> NDArray[np.float64]:
    """Median line integral of the air in each view, ``(views,)``; parameters as of `normalize_air`."""
    rows, columns = scan.geometry.shape
    if (margin is None) == (region is None):
        raise InputError(
            "air", "give either margin or region", "margin = columns at both sides, or region = [r0, r1, c0, c1]"
        )
    air = np.zeros((rows, columns), dtype=bool)
    if margin is not None:
        if not 0 < margin <= columns // 2:
            raise InputError("air.margin", f"must be 1 to {columns // 2} columns, got {margin}", "give fewer columns")
        air[:, :margin] = air[:, columns - margin :] = True
    elif region is not None:
        r0, r1, c0, c1 = region
        if not (0 <= r0 < r1 <= rows and 0 <= c0 < c1 <= columns):
            fact = f"{list(region)} is not inside the panel of {rows} rows and {columns} columns"
            raise InputError("air.region", fact, "give [row0, row1, column0, column1], end excluded")
        air[r0:r1, c0:c1] = True
    levels = scan.air_medians(air)
    if np.isnan(levels).any():
        view = int(np.argmax(np.isnan(levels)))
        raise InputError("air", f"view {view} has no good pixel there", "choose another margin or region")
    return levels


@checked_arguments
def normalize_air(scan: Scan, *, margin: int | None = None, region: tuple[int, int, int, int] | None = None) -> Scan:
    """Scale the beam by one factor a view so that air has a line integral of 0.

    Parameters
    ----------
    scan : Scan
        Line integrals whose air is not at 0.
    margin : int, optional
        Columns at the left and as many at the right of the panel that show only air.
    region : (row0, row1, column0, column1), optional
        Pixels that show only air, end excluded; give either this or ``margin``.

    Returns
    -------
    Scan
        With the median line integral of the air subtracted from each radiograph.

    Raises
    ------
    InputError
        If neither or both of ``margin`` and ``region`` are given, or no good pixel lies there.

    Examples
    --------
    >>> levelled = gm.normalize_air(state, margin=4)  # four columns at the left and right show air
    >>> bool(abs(np.median(levelled.line_integrals[:, :, :4])) < 0.01)
    True
    """
    return scan.levelled(air_levels(scan, margin=margin, region=region))


@checked_arguments
def snr(scan_a: Scan, scan_b: Scan) -> float:
    """Signal-to-noise ratio from two scans of the same state, √2 ‖b₁‖/‖b₁ − b₂‖.

    Eq. 24 of Khalili et al. (2017), doi 10.1007/s11340-017-0263-5.

    Parameters
    ----------
    scan_a, scan_b : Scan
        Of the same views.

    Returns
    -------
    float
        Infinite if the scans are equal.

    Raises
    ------
    InputError
        If their shapes differ.

    Examples
    --------
    >>> again = case.state(truth, (0, 45, 90, 135), number=2)  # the same state, other noise
    >>> 45 < gm.snr(state, again) < 55
    True
    """
    if scan_a.line_integrals.shape != scan_b.line_integrals.shape:
        fact = f"shapes {scan_a.line_integrals.shape} and {scan_b.line_integrals.shape} differ"
        raise InputError("snr", fact, "give two scans of the same state by the same views")
    good = np.ones(scan_a.line_integrals.shape, dtype=bool)
    for valid in (scan_a.valid, scan_b.valid):
        good &= True if valid is None else valid
    b1, b2 = (s.line_integrals[good].astype(float) for s in (scan_a, scan_b))
    noise = float(np.linalg.norm(b1 - b2))
    return float(np.sqrt(2) * np.linalg.norm(b1) / noise) if noise > 0 else float("inf")
