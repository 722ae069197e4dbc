"""Arrays and records inside the page: compressed and as text, decoded by ``assets/decode.js``."""

from __future__ import annotations

import base64
import json
import zlib

import numpy as np
from numpy.typing import ArrayLike

from grainmotion.model.progress import counted

COMPRESSION_LEVEL = 9
PACKED_AT_ONCE = 1 << 19
"""Bytes that are compressed between two reports of progress: some tenths of a second."""
Embedded = dict[str, object]
"""What `embed` returns: ``dtype``, ``shape`` and ``data``, ready for JSON."""


def embed(array: ArrayLike) -> Embedded:
    """An array for the page's JSON.

    Bytes are little-endian and shuffled (first bytes of all numbers, then second bytes, ...), which makes numbers of
    similar size compress about twice as well; then zlib and base64.

    Parameters
    ----------
    array : array
        Of integers, booleans (stored as uint8) or floats (stored as float32) of 1, 2 or 4 bytes.

    Returns
    -------
    dict
        ``{"dtype": "<f4", "shape": [n, 3], "data": "..."}``.

    Raises
    ------
    TypeError
        If the numbers are of a kind that browsers have no array for.
    """
    values = np.asarray(array)
    if values.dtype == bool:
        values = values.astype(np.uint8)
    elif values.dtype.kind == "f":
        values = values.astype(np.float32)
    if values.dtype.kind not in "iuf" or values.dtype.itemsize > 4:
        raise TypeError(f"numbers of type {values.dtype} cannot be put on the page; use 4 bytes or fewer")
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    by_number = little.reshape(-1).view(np.uint8).reshape(little.size, little.dtype.itemsize)
    shuffled = np.ascontiguousarray(by_number.T).tobytes()
    kind = f"{little.dtype.kind}{little.dtype.itemsize}"
    return {"dtype": f"<{kind}", "shape": list(little.shape), "data": _packed(shuffled)}


def embed_json(record: object) -> Embedded:
    """A record of plain data, compressed; the page decodes it when it is needed."""
    text = json.dumps(record, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return {"dtype": "json", "data": _packed(text.encode("utf-8"))}


def rounded(values: ArrayLike, digits: int) -> np.ndarray:
    """Floats with about ``digits`` significant decimal digits; the zeros in their last bits compress well."""
    array = np.ascontiguousarray(values, dtype=np.float32)
    drop = max(0, 23 - int(np.ceil(digits * np.log2(10))))
    bits = array.view(np.uint32).astype(np.uint64)
    kept = ((bits + (1 << drop >> 1)) & ~np.uint64((1 << drop) - 1)).astype(np.uint32).view(np.float32)
    return np.where(np.isfinite(array), kept, array)


def _packed(data: bytes) -> str:
    compressor = zlib.compressobj(COMPRESSION_LEVEL)
    parts = [compressor.compress(data[first : first + PACKED_AT_ONCE])
             for first in counted(range(0, len(data), PACKED_AT_ONCE))]  # fmt: skip
    return base64.b64encode(b"".join((*parts, compressor.flush()))).decode("ascii")
