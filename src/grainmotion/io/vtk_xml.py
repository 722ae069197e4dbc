"""VTK's XML files: arrays appended as zlib blocks of raw little-endian numbers, and the elements that name them.

As the `VTK file formats <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>`_ describe.  Text
arrays are zero-terminated strings; readers in Python take ASCII only.
"""

from __future__ import annotations

import struct
import unicodedata
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from grainmotion.io.files import atomic_write
from grainmotion.model.progress import counted

BLOCK_BYTES = 1 << 20  # compressed at a time
VTK_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
ASCII = str.maketrans({"°": " deg", "±": "+-", "−": "-", "–": "-", "≥": ">=", "≤": "<=", "×": "x", "ω": "w", "σ": "sd"})
"""What replaces signs that are not ASCII in texts."""
VTK_FRAME = "sample frame: right-handed, z up along the rotation axis, origin on the axis"


class VtkXml:
    """The body of a file that is being made: elements are returned as text, their arrays kept compressed."""

    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self.size = 0

    def array(self, name: str, values: NDArray[np.generic]) -> str:
        """Append ``values`` (one row a point or cell) and return its ``DataArray`` element."""
        return self.array_of_pieces(name, [values], values.dtype, values.shape[1] if values.ndim == 2 else 1)

    def array_of_pieces(
        self, name: str, pieces: Iterable[NDArray[np.generic]], dtype: np.dtype, components: int = 1
    ) -> str:
        """The same of an array that comes piece by piece, so that it need not be in memory as a whole."""
        little = np.dtype(dtype).newbyteorder("<")
        kind = VTK_TYPES[little.str[1:]]
        element = (
            f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{components}" '
            f'format="appended" offset="{self.size}"/>'
        )
        self._append(chunk for piece in pieces for chunk in _chunks(piece, little))
        return element

    def texts(self, name: str, texts: Sequence[str]) -> str:
        """Append texts and return their ``Array`` element."""
        element = (
            f'<Array type="String" Name={quoteattr(name)} NumberOfTuples="{len(texts)}" format="appended" '
            f'offset="{self.size}"/>'
        )
        self._append([b"".join(plain(text).encode("ascii") + b"\0" for text in texts)])
        return element

    def group(self, tag: str, data: Mapping[str, NDArray[np.generic] | Sequence[str]], **active: str) -> str:
        """A ``PointData``, ``CellData`` or ``FieldData`` element of several arrays."""
        attributes = "".join(f" {key}={quoteattr(value)}" for key, value in active.items())
        elements = [self.array(k, v) if isinstance(v, np.ndarray) else self.texts(k, v) for k, v in data.items()]
        return f"<{tag}{attributes}>" + "".join(elements) + f"</{tag}>"

    def field(self, facts: Mapping[str, NDArray[np.generic] | Sequence[str]]) -> str:
        """A ``FieldData`` element: facts about the whole, with the program and the frame."""
        made = {"software": [f"grainmotion {version('grainmotion')}"], "frame": [VTK_FRAME]}
        elements = []
        for name, value in {**made, **facts}.items():
            if isinstance(value, np.ndarray):
                element = self.array(name, value)
                elements.append(element.replace(" format=", f' NumberOfTuples="{len(value)}" format=', 1))
            else:
                elements.append(self.texts(name, value))
        return "<FieldData>" + "".join(elements) + "</FieldData>"

    def _append(self, chunks: Iterable[bytes]) -> None:
        """Compress the bytes in blocks of equal size; a header with all sizes goes before them."""
        parts, pending, total = list[bytes](), bytearray(), 0
        for chunk in chunks:
            total += len(chunk)
            pending += chunk
            while len(pending) >= BLOCK_BYTES:
                parts.append(zlib.compress(pending[:BLOCK_BYTES], 6))
                del pending[:BLOCK_BYTES]
        if pending:
            parts.append(zlib.compress(pending, 6))
        header = [len(parts), BLOCK_BYTES, total % BLOCK_BYTES, *(len(p) for p in parts)]
        for block in (struct.pack(f"<{len(header)}Q", *header), *parts):
            self.blocks.append(block)
            self.size += len(block)

    def write(self, path: str | Path, kind: str, body: str) -> None:
        """Write the file of type ``kind`` whose element has the content ``body``."""
        head = (
            f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" '
            f'header_type="UInt64" compressor="vtkZLibDataCompressor">\n{body}\n<AppendedData encoding="raw">_'
        )
        with atomic_write(path) as part, part.open("wb") as stream:
            stream.write(head.encode())
            for block in self.blocks:
                stream.write(block)
            stream.write(b"\n</AppendedData>\n</VTKFile>\n")


def _chunks(values: NDArray[np.generic], dtype: np.dtype) -> Iterator[bytes]:
    """The bytes of an array, a block at a time: a large volume is not copied as a whole."""
    flat = np.ascontiguousarray(values).reshape(-1)
    step = BLOCK_BYTES // dtype.itemsize
    for start in counted(range(0, flat.size, step)):
        yield flat[start : start + step].astype(dtype, copy=False).tobytes()


def plain(text: str) -> str:
    """The text in ASCII."""
    return unicodedata.normalize("NFKD", text.translate(ASCII)).encode("ascii", "ignore").decode("ascii")
