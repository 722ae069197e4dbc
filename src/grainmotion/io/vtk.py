"""VTK's XML files for ParaView: grains as points and as surfaces (``.vtp``), voxel images (``.vti``), time (``.pvd``).

Lengths are in mm, in the sample frame (x y z), so that all of them overlay each other.  `grainmotion.io.vtk_xml` writes
the format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write
from grainmotion.io.vtk_xml import VtkXml
from grainmotion.model.motions import Motions, Status
from grainmotion.model.strain import tensors
from grainmotion.model.volume import Volume
from grainmotion.rotations import apply_motion

STATUS_CODES: dict[str, int] = {status.value: code for code, status in enumerate(Status)}
"""Code of each status in the point array ``status_code``: 0 converged, 1 not-converged, 2 poorly-determined,
3 left-field, 4 not-fitted, 5 ambiguous, 6 absent, 7 cut, 8 broken, 9 deformed (the order of `Status`)."""
WITHOUT_PLACE = (Status.LEFT_FIELD.value, Status.NOT_FITTED.value, Status.ABSENT.value)
"""Statuses of grains whose place in a state is not known: no surface is drawn there."""
REFERENCE_CODE = -1
"""``status_code`` in the files of the reference state."""


class Mesh(Protocol):
    """Triangles of one grain in the reference state."""

    @property
    def vertices(self) -> NDArray[np.floating]:
        """``(n, 3)``, mm, x y z."""

    @property
    def faces(self) -> NDArray[np.integer]:
        """``(m, 3)``, rows of vertices."""


def write_grains_vtp(path: str | Path, motions: Motions, *, time: float | None = None, reference: bool = False) -> None:
    """Write grains as points of a ``.vtp`` file.

    Each grain is a vertex at its current centre c + u (at c if u is NaN).  Point arrays hold every column of
    ``motions.csv``: ``label``, ``status`` and ``reason`` (texts), ``status_code`` (see `STATUS_CODES`, in the file as
    the field array ``status_names``), ``ok_translation`` and ``ok_rotation`` (0 or 1), ``reference_center`` (mm),
    ``displacement`` u (mm), ``rotation_vector_deg`` (degrees), ``rotation_matrix`` Ω (row-major tensor),
    ``sd_displacement`` (mm), ``sd_rotation_deg`` (degrees), ``displacement_covariance`` (tensor, mm²), ``residual``
    (line-integral units) and ``iterations``; where strains were measured ``strain`` (tensor, frame of the reference)
    and ``sd_strain`` (xx, yy, zz, yz, xz, xy).  To colour by: ``displacement_magnitude`` (mm), ``rotation_angle_deg``,
    and the roots of the summed variances, ``uncertainty_displacement`` (mm) and ``uncertainty_rotation_deg`` (√3 times
    the root mean squares of the components that the report shows).
    Missing values are NaN: threshold on ``ok_translation`` before drawing glyphs.

    ``time`` is the time step; ``reference`` says that the motions are those of the reference state, which did not move.
    """
    n = len(motions)
    points = np.where(np.isfinite(motions.translations), motions.centers + motions.translations, motions.centers)
    data: dict[str, NDArray[np.generic] | Sequence[str]] = {
        **_columns(motions, reference=reference),
        "rotation_matrix": motions.matrices.reshape(n, 9),
        "displacement_covariance": motions.covariances[:, :3, :3].reshape(n, 9),
        "status": ["reference"] * n if reference else [str(s) for s in motions.statuses],
        "reason": list(motions.reasons),
    }
    if motions.strains is not None:
        data["strain"] = tensors(motions.strains).reshape(n, 9)
    body = VtkXml()
    point_data = body.group("PointData", data, Scalars="status_code", Vectors="displacement", Tensors="rotation_matrix")
    positions = "<Points>" + body.array("Points", points) + "</Points>"
    cells = (
        "<Verts>"
        + body.array("connectivity", np.arange(n, dtype="<i8"))
        + body.array("offsets", np.arange(1, n + 1, dtype="<i8"))
        + "</Verts>"
    )
    piece = f'<Piece NumberOfPoints="{n}" NumberOfVerts="{n}">{point_data}{positions}{cells}</Piece>'
    body.write(path, "PolyData", f"<PolyData>{_field(body, time)}{piece}</PolyData>")


def write_surfaces_vtp(
    path: str | Path,
    meshes: Sequence[tuple[int, Mesh]],
    motions: Motions,
    *,
    time: float | None = None,
    reference: bool = False,
) -> None:
    """Write grains as surfaces of triangles, each moved by its motion, in one ``.vtp`` file.

    ``meshes`` are labels and triangles of grains in the reference state.  Grains without a motion, and those whose
    status is ``left-field``, ``not-fitted`` or ``absent``, are left out.  Every point has the numbers of its grain, as
    in `write_grains_vtp` but for the matrices, in single precision.  Written grain by grain.
    """
    row_of = {int(label): row for row, label in enumerate(motions.labels)}
    placed = np.isfinite(np.hstack([motions.translations, motions.rotations])).all(axis=1)
    placed &= np.ones(len(motions), dtype=bool) if reference else ~np.isin(motions.statuses, WITHOUT_PLACE)
    drawn = [(row_of[label], mesh) for label, mesh in meshes if label in row_of and placed[row_of[label]]]
    counts = np.array([len(mesh.vertices) for _, mesh in drawn], dtype=np.int64)
    triangles = sum(len(mesh.faces) for _, mesh in drawn)
    gradients = motions.gradients

    def moved() -> Iterator[Float]:
        for row, mesh in drawn:
            place = motions.translations[row], motions.centers[row]
            yield apply_motion(gradients[row], *place, mesh.vertices).astype(np.float32)

    def connectivity() -> Iterator[NDArray[np.int64]]:
        for first, (_, mesh) in zip(np.cumsum(counts) - counts, drawn, strict=True):
            yield (mesh.faces + first).astype(np.int64)

    def repeated(values: NDArray[np.generic]) -> Callable[[], Iterator[NDArray[np.generic]]]:
        return lambda: (np.repeat(values[row][None], len(mesh.vertices), axis=0) for row, mesh in drawn)

    body, elements = VtkXml(), list[str]()
    for name, values in _columns(motions, reference=reference).items():
        values = values.astype(np.float32) if values.dtype.kind == "f" else values
        components = values.shape[1] if values.ndim == 2 else 1
        elements.append(body.array_of_pieces(name, repeated(values)(), values.dtype, components))
    data = f'<PointData Scalars="status_code" Vectors="displacement">{"".join(elements)}</PointData>'
    points = f"<Points>{body.array_of_pieces('Points', moved(), np.dtype('<f4'), 3)}</Points>"
    links = body.array_of_pieces("connectivity", connectivity(), np.dtype("<i8"))
    ends = body.array("offsets", np.arange(3, 3 * triangles + 1, 3, dtype="<i8"))
    piece = (
        f'<Piece NumberOfPoints="{counts.sum()}" NumberOfPolys="{triangles}">{data}{points}'
        f"<Polys>{links}{ends}</Polys></Piece>"
    )
    body.write(path, "PolyData", f"<PolyData>{_field(body, time)}{piece}</PolyData>")


def write_image_vti(path: str | Path, volume: Volume, labels: NDArray[np.integer] | None = None) -> None:
    """Write a volume as a ``.vti`` image, one cell a voxel: ``attenuation`` (1/mm), and ``label`` if given."""
    data: dict[str, NDArray[np.generic] | Sequence[str]] = {"attenuation": volume.array.ravel()}
    if labels is not None:
        if labels.shape != volume.shape:
            raise InputError("labels", f"shape {labels.shape} is not the volume's {volume.shape}", "give one a voxel")
        data["label"] = labels.astype("<i4", copy=False).ravel()
    body, units = VtkXml(), {"units": ["lengths mm", "attenuation 1/mm"]}
    cell_data = body.group("CellData", data, Scalars="attenuation")
    extent = " ".join(f"0 {n}" for n in volume.shape[::-1])
    corner = " ".join(repr(float(x)) for x in volume.origin - volume.voxel_size / 2)
    spacing = " ".join([repr(volume.voxel_size)] * 3)
    image = (
        f'<ImageData WholeExtent="{extent}" Origin="{corner}" Spacing="{spacing}">{body.field(units)}'
        f'<Piece Extent="{extent}">{cell_data}</Piece></ImageData>'
    )
    body.write(path, "ImageData", image)


def write_pvd(path: str | Path, steps: Sequence[tuple[float, Path]]) -> None:
    """Write a ``.pvd`` collection: files of time steps, named from the collection's own folder."""
    folder = Path(path).parent
    sets = "".join(
        f'<DataSet timestep="{float(time)!r}" part="0" file={quoteattr(file.relative_to(folder).as_posix())}/>\n'
        for time, file in steps
    )
    head, end = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n', "</Collection>\n"
    with atomic_write(path) as part:
        part.write_text(f"{head}{sets}{end}</VTKFile>\n", encoding="utf-8")


def _columns(motions: Motions, *, reference: bool) -> dict[str, NDArray[np.generic]]:
    """Numbers of each grain, ``(n,)`` or ``(n, k)``, and what people colour by."""
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.diagonal(motions.covariances, axis1=1, axis2=2))
    codes = [REFERENCE_CODE if reference else STATUS_CODES[str(s)] for s in motions.statuses]
    columns: dict[str, NDArray[np.generic]] = {
        "label": motions.labels.astype("<i8"),
        "status_code": np.array(codes, dtype="<i4"),
        "ok_translation": motions.ok_translation.astype("u1"),
        "ok_rotation": motions.ok_rotation.astype("u1"),
        "reference_center": motions.centers,
        "displacement": motions.translations,
        "displacement_magnitude": np.linalg.norm(motions.translations, axis=1),
        "rotation_vector_deg": np.rad2deg(motions.rotations),
        "rotation_angle_deg": np.rad2deg(np.linalg.norm(motions.rotations, axis=1)),
        "sd_displacement": sd[:, :3],
        "sd_rotation_deg": np.rad2deg(sd[:, 3:]),
        "uncertainty_displacement": np.linalg.norm(sd[:, :3], axis=1),
        "uncertainty_rotation_deg": np.rad2deg(np.linalg.norm(sd[:, 3:], axis=1)),
        "residual": motions.residuals,
        "iterations": motions.iterations.astype("<i8"),
    }
    if motions.strain_sd is not None:
        columns["sd_strain"] = motions.strain_sd
    return columns


def _field(body: VtkXml, time: float | None) -> str:
    """What holds for the whole file: meaning of the codes, units, time."""
    names = [f"{code} {name}" for name, code in {"reference": REFERENCE_CODE, **STATUS_CODES}.items()]
    facts: dict[str, NDArray[np.generic] | Sequence[str]] = {
        "status_names": names,
        "units": ["lengths mm", "*_deg degrees", "residual line integrals"],
    }
    if time is not None:
        facts["TimeValue"] = np.array([time], dtype="<f8")
    return body.field(facts)
