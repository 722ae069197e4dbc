"""What readers of views need to know of the panel beside their file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from grainmotion._typing import Beam


@dataclass(frozen=True)
class Panel:
    """What images and experiment file tell of a panel.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the images.
    pixel_size : float, optional
        mm; only formats without the pixels' steps, or without a unit, need it.
    first_row : {"top", "bottom"}, optional
        Where row 0 of the images lies; only formats that do not tell need it.
    beam : {"cone", "parallel"}
        Kind of beam, of formats that do not tell.
    offset : (float, float)
        Of the panel's centre along u and v from where the file has it, mm; only of formats with an origin of their own.
    """

    shape: tuple[int, int]
    pixel_size: float | None = None
    first_row: Literal["top", "bottom"] | None = None
    beam: Beam = "cone"
    offset: tuple[float, float] = (0.0, 0.0)
