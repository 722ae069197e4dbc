"""ViewShifts: how far each radiograph of a full scan is from where the others predict it."""

from __future__ import annotations

from dataclasses import dataclass

from grainmotion._typing import Float, Index


@dataclass(frozen=True, eq=False)
class ViewShifts:
    """Shifts of the views of a full scan against what the others predict.

    Attributes
    ----------
    values : (n, 2) array
        Along u and v, pixels of the scan: the image is so far from its prediction, in columns and rows.
    turns : (n,) array
        Radians, about the panel's centre: a pixel at (row, column) from it is moved by (-column, row) times this.
    views : (n,) int array
        Their numbers in the scan.
    times : (n,) array
        Of each view, from -1/2 to 1/2.
    along : (n, 2) array
        x and y of each view's unit vector along u.
    pixel : float
        Size of a pixel of the scan at the sample, mm.
    half_width : float
        Half the panel's width, pixels.
    """

    values: Float
    turns: Float
    views: Index
    times: Float
    along: Float
    pixel: float
    half_width: float
