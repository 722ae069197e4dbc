"""Images with colour channels that are grey in truth."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError


def grey(pixels: Pixels, where: str) -> Pixels:
    """One channel of ``(..., rows, columns, channels)`` pixels if all colours are alike; grey images pass unchanged.

    Two channels are grey and opacity, four are colours and opacity.  Colours that differ are refused.
    """
    if pixels.ndim < 3 or pixels.shape[-1] not in (2, 3, 4):
        return pixels
    colours = pixels[..., :3] if pixels.shape[-1] > 2 else pixels[..., :1]
    if np.any(colours != colours[..., :1]):
        fact = "a colour image: its red, green and blue differ"
        raise InputError(where, fact, "save grey images, without colours")
    return np.ascontiguousarray(pixels[..., 0])
