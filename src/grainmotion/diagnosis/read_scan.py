"""A scan as it was read, for the checks of its frames and grey values, and samples of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.scan import Scan
from grainmotion.preprocessing.masked_pixels import PixelReport
from grainmotion.preprocessing.outliers import Mask

MAX_LEVEL_PIXELS = 1 << 14
"""Pixels of an image from which its levels are estimated."""
BORDER_SHARE = 0.02
"""Columns at each side of the panel, where most scans see air, as a share of all."""
MAX_SIDES_APART = 0.02
"""Median difference of the line integrals at the two borders where both see air, beside the noise.

Scans with air at both sides gave up to 0.003, a sample wider than the panel 0.03 to 0.04."""
BLACK = 0.1
"""Brightest parts of a black radiograph over those of the other views.  Sound views: 0.7 and more."""
VIEW_BLOCKS = 24
"""Parts of a radiograph along each side, averaged, in which views are compared."""


@dataclass(frozen=True, eq=False)
class ReadScan:
    """A scan as it was read.

    Attributes
    ----------
    key : str
        "reference" or "states.NAME".
    names : mapping
        File and key of "radiographs", "flats" and "darks", for messages.
    kind : str
        What the pixels of the files are.
    images : (views, rows, columns) array
        Radiographs as in the files.
    flats, darks : (n, rows, columns) array, optional
        Likewise.
    scan : Scan
        Their line integrals.
    pixels : PixelReport
        What was masked.
    top : float, optional
        Count that was found to be the top of the camera's range.
    """

    key: str
    names: Mapping[str, str]
    kind: str
    images: NDArray
    flats: NDArray | None
    darks: NDArray | None
    scan: Scan
    pixels: PixelReport
    top: float | None = None

    @cached_property
    def thinned(self) -> NDArray[np.floating]:
        """Line integrals ``(views, rows, columns)`` of some of the pixels."""
        step = max(1, int(np.sqrt(self.images[0].size / MAX_LEVEL_PIXELS)))
        return self.scan.line_integrals[:, ::step, ::step]

    @cached_property
    def lit(self) -> Float:
        """Transmission of the brightest parts of each view, ``(views,)``."""
        return np.exp(-np.percentile(self.thinned.reshape(len(self.thinned), -1), 2, axis=1))

    @cached_property
    def black(self) -> Mask:
        """Views without beam, ``(views,)``."""
        found: Mask = self.lit < BLACK * np.percentile(self.lit, 75)
        return found

    @cached_property
    def sides(self) -> Float:
        """Median line integral of the columns at the left and at the right, ``(views, 2)``."""
        images = self.scan.line_integrals
        width = border_width(images.shape[2])
        return np.stack([np.median(images[:, :, part], axis=(1, 2)) for part in borders(width)], axis=1)

    @cached_property
    def sees_air(self) -> bool:
        """Whether the panel sees air at both sides of the sample, as far as the borders tell."""
        left, right = self.sides.T
        return bool(np.median(np.abs(left - right)) < MAX_SIDES_APART)

    @cached_property
    def blocks(self) -> Float:
        """Mean line integrals of parts of the views, ``(views, parts)``."""
        images = self.scan.line_integrals
        rows, columns = (max(1, side // VIEW_BLOCKS) for side in images.shape[1:])
        height, width = images.shape[1] // rows, images.shape[2] // columns
        cut = images[:, : height * rows, : width * columns]
        means = cut.reshape(len(cut), height, rows, width, columns).mean(axis=(2, 4), dtype=float)
        return means.reshape(len(cut), -1)


def border_width(columns: int) -> int:
    """Columns at each side of the panel that are its border."""
    return max(1, round(BORDER_SHARE * columns))


def borders(width: int) -> tuple[slice, slice]:
    """Columns at the left and at the right."""
    return slice(None, width), slice(-width, None)


def middle_of(images: NDArray) -> tuple[slice, slice]:
    """Rows and columns in the middle of the panel, where the sample is."""
    rows, columns = images.shape[1:]
    return slice(rows // 4, rows - rows // 4), slice(columns // 3, columns - columns // 3)
