"""PNG: grey images of 8 or 16 bits, without loss."""

from __future__ import annotations

import struct
from pathlib import Path

import imagecodecs
import numpy as np

from grainmotion._typing import Pixels
from grainmotion.errors import InputError
from grainmotion.io.colour import grey
from grainmotion.io.files import checked_file

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PALETTE = 3  # colour type whose pixels are numbers of colours


def png_info(path: str | Path) -> tuple[tuple[int, int, int], np.dtype]:
    """Shape (1, rows, columns) and type of a PNG file, from its header; palettes and less than 8 bits are refused."""
    path = checked_file(path)
    with path.open("rb") as file:
        header = file.read(26)
    if len(header) < 26 or not header.startswith(_SIGNATURE):
        raise InputError(str(path), "not a PNG file, or truncated", "copy or export the file again")
    columns, rows, bits, colours = struct.unpack(">IIBB", header[16:26])
    if colours == _PALETTE or bits < 8:
        fact = f"a PNG with a palette or of {bits} bits a pixel: its pixels are no counts"
        raise InputError(str(path), fact, "export the radiographs as 16-bit grey TIFF or PNG")
    return (1, rows, columns), np.dtype(np.uint8 if bits == 8 else np.uint16)


def read_png(path: str | Path) -> Pixels:
    """Pixels ``(1, rows, columns)``, of 8 or 16 bits; an image with colours that differ is refused."""
    shape, _ = png_info(path)
    try:
        pixels = imagecodecs.png_decode(Path(path).read_bytes())
    except Exception as error:
        fact = f"truncated or damaged PNG ({error})"
        raise InputError(str(path), fact, "copy or export the file again") from error
    return grey(np.asarray(pixels), str(path)).reshape(shape)
