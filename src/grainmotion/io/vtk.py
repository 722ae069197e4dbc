"""VTK's XML files for ParaView: grains as points (``.vtp``), voxel images (``.vti``).

Lengths are in mm, in the sample frame (x y z), so that both kinds of file overlay each other.  Arrays are
appended as zlib blocks of raw little-endian numbers, as the `VTK file formats
<https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>`_ describe.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write
from grainmotion.model.motions import Motions, Status
from grainmotion.model.strain import tensors
from grainmotion.model.volume import Volume

STATUS_CODES: dict[str, int] = {status.value: code for code, status in enumerate(Status)}
"""Code of each status in the point array ``status_code``: 0 converged, 1 not-converged, 2 poorly-determined,
3 left-field, 4 not-fitted, 5 ambiguous, 6 absent, 7 cut, 8 broken, 9 deformed (the order of `Status`)."""

BLOCK_BYTES = 1 << 20  # compressed at a time
_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


def write_grains_vtp(path: str | Path, motions: Motions) -> None:
    """Write grains as points of a ``.vtp`` file.

    Each grain is a vertex at its current centre c + u (at c if u is NaN).  Point arrays: ``label``, ``status_code``
    (see `STATUS_CODES`), ``ok_translation`` and ``ok_rotation`` (0 or 1), ``reference_center`` (mm), ``displacement``
    u (mm), ``rotation_vector_deg`` (degrees), ``rotation_matrix`` Ω (row-major tensor), ``sd_displacement`` (mm),
    ``sd_rotation_deg`` (degrees), ``displacement_covariance`` (tensor, mm²), ``residual`` (line-integral units) and
    ``iterations``; where strains were measured ``strain`` (tensor, frame of the reference) and ``sd_strain`` (xx, yy,
    zz, yz, xz, xy).  Missing values are NaN: threshold on ``ok_translation`` before drawing glyphs.
    """
    n = len(motions)
    points = np.where(np.isfinite(motions.translations), motions.centers + motions.translations, motions.centers)
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(motions.covariances, axis1=1, axis2=2))
    data = {
        "label": motions.labels.astype("<i8"),
        "status_code": np.array([STATUS_CODES[str(s)] for s in motions.statuses], dtype="<i4"),
        "ok_translation": motions.ok_translation.astype("u1"),
        "ok_rotation": motions.ok_rotation.astype("u1"),
        "reference_center": motions.centers,
        "displacement": motions.translations,
        "rotation_vector_deg": np.rad2deg(motions.rotations),
        "rotation_matrix": motions.matrices.reshape(n, 9),
        "sd_displacement": sd[:, :3],
        "sd_rotation_deg": np.rad2deg(sd[:, 3:]),
        "displacement_covariance": motions.covariances[:, :3, :3].reshape(n, 9),
        "residual": motions.residuals,
        "iterations": motions.iterations.astype("<i8"),
    }
    if motions.strains is not None and motions.strain_sd is not None:
        data |= {"strain": tensors(motions.strains).reshape(n, 9), "sd_strain": motions.strain_sd}
    body = _Appended()
    point_data = body.group("PointData", data, Scalars="status_code", Vectors="displacement", Tensors="rotation_matrix")
    positions = "<Points>" + body.array("Points", points) + "</Points>"
    cells = (
        "<Verts>"
        + body.array("connectivity", np.arange(n, dtype="<i8"))
        + body.array("offsets", np.arange(1, n + 1, dtype="<i8"))
        + "</Verts>"
    )
    piece = f'<Piece NumberOfPoints="{n}" NumberOfVerts="{n}">{point_data}{positions}{cells}</Piece>'
    _write(path, "PolyData", f"<PolyData>{piece}</PolyData>", body)


def write_image_vti(path: str | Path, volume: Volume, labels: NDArray[np.integer] | None = None) -> None:
    """Write a volume as a ``.vti`` image, one cell a voxel: ``attenuation`` (1/mm), and ``label`` if given."""
    data: dict[str, NDArray[np.generic]] = {"attenuation": volume.array.ravel()}
    if labels is not None:
        if labels.shape != volume.shape:
            raise InputError("labels", f"shape {labels.shape} is not the volume's {volume.shape}", "give one a voxel")
        data["label"] = labels.astype("<i4").ravel()
    body = _Appended()
    cell_data = body.group("CellData", data, Scalars="attenuation")
    extent = " ".join(f"0 {n}" for n in volume.shape[::-1])
    corner = " ".join(repr(float(x)) for x in volume.origin - volume.voxel_size / 2)
    spacing = " ".join([repr(volume.voxel_size)] * 3)
    image = (
        f'<ImageData WholeExtent="{extent}" Origin="{corner}" Spacing="{spacing}">'
        f'<Piece Extent="{extent}">{cell_data}</Piece></ImageData>'
    )
    _write(path, "ImageData", image, body)


class _Appended:
    """The ``AppendedData`` of a file: arrays as compressed blocks, and the headers that point to them."""

    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self.size = 0

    def array(self, name: str, values: NDArray[np.generic]) -> str:
        """Append ``values`` (one row a point or cell) and return its ``DataArray`` element."""
        values = np.ascontiguousarray(values)
        kind = _TYPES[values.dtype.newbyteorder("<").str[1:]]
        components = values.shape[1] if values.ndim == 2 else 1
        element = (
            f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{components}" '
            f'format="appended" offset="{self.size}"/>'
        )
        raw = values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes()
        parts = [zlib.compress(raw[i : i + BLOCK_BYTES], 6) for i in range(0, len(raw), BLOCK_BYTES)]
        header = [len(parts), BLOCK_BYTES, len(raw) % BLOCK_BYTES, *(len(p) for p in parts)]
        for block in (struct.pack(f"<{len(header)}Q", *header), *parts):
            self.blocks.append(block)
            self.size += len(block)
        return element

    def group(self, tag: str, data: Mapping[str, NDArray[np.generic]], **active: str) -> str:
        """A ``PointData`` or ``CellData`` element of several arrays."""
        attributes = "".join(f" {key}={quoteattr(value)}" for key, value in active.items())
        return f"<{tag}{attributes}>" + "".join(self.array(k, v) for k, v in data.items()) + f"</{tag}>"

    def write(self, stream: BinaryIO) -> None:
        for block in self.blocks:
            stream.write(block)


def _write(path: str | Path, kind: str, body: str, appended: _Appended) -> None:
    head = (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64" compressor="vtkZLibDataCompressor">\n{body}\n<AppendedData encoding="raw">_'
    )
    with atomic_write(path) as part, part.open("wb") as stream:
        stream.write(head.encode())
        appended.write(stream)
        stream.write(b"\n</AppendedData>\n</VTKFile>\n")
