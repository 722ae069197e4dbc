"""Files of one grain's shape for DEM codes: STL, level sets (YADE, LS-DEM, LAMMPS), spheres of a clump.

All lengths are mm in the body's own frame (`grain_shapes.rigid_body`), but for the files of LS-DEM, whose unit of
length is the spacing of the grid.  Sources of the formats:

- STL: 80 bytes of header, the number of triangles, and per triangle a normal, three corners and two bytes.
- YADE has no file of its own; `.npz` holds what its `levelSetBody(grid, distField, surfNodes)` takes.
- LS-DEM: the grain files of Kawamoto, Andò, Viggiani and Andrade (J. Mech. Phys. Solids 91, 2016), as the reader of the
  public code github.com/tanpeng1995/LS-DEM_Parallel_Benchmark takes them.  Its quaternions are (y, −x, −z, w).
- LAMMPS: the grid files of ``fix rigid/small/ls/dem``.
- LIGGGHTS (``fix particletemplate/multisphere … spheres file``) and YADE (``ymport.textExt``) read lines of x y z r.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.grain_shapes.clump import Clump
from grainmotion.grain_shapes.level_set import LevelSet
from grainmotion.grain_shapes.mass_properties import MassProperties
from grainmotion.grain_shapes.triangle_mesh import Surface
from grainmotion.io.files import atomic_write

STL_HEADER_BYTES = 80


def made_by() -> str:
    """Name and version of the program, for the heads of files."""
    return f"grainmotion {version('grainmotion')}"


def write_stl(path: str | Path, surface: Surface, name: str) -> None:
    """Write a surface as binary STL, mm; the header has the name, the unit and the version."""
    records = np.zeros(
        len(surface.faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
    )
    records["normal"], records["corners"] = surface.normals, surface.corners
    head = f"{name}, mm, {made_by()}".encode("ascii", "replace")[:STL_HEADER_BYTES].ljust(STL_HEADER_BYTES)
    with atomic_write(path) as part, part.open("wb") as stream:
        stream.write(head + np.uint32(len(records)).astype("<u4").tobytes() + records.tobytes())


def write_level_set_npz(path: str | Path, field: LevelSet, nodes: Float, label: int) -> None:
    """Write a level set for YADE.

    Arrays: ``distance`` (nx, ny, nz) in mm, negative inside; ``minimum`` (3,), place of its first point, mm;
    ``spacing``, mm; ``nodes`` (k, 3), points of the surface, mm; ``label``; ``made_by``.
    """
    with atomic_write(path) as part, part.open("wb") as stream:
        np.savez_compressed(
            stream, distance=field.values.transpose(2, 1, 0).astype(np.float32), minimum=field.origin,
            spacing=field.spacing, nodes=nodes, label=label, made_by=made_by(),
        )  # fmt: skip


def write_ls_dem_grain(path: str | Path, field: LevelSet, nodes: Float, properties: MassProperties) -> None:
    """Write a grain of LS-DEM, in units of the grid's spacing, at density 1.

    Lines: mass; principal moments of inertia; centre of mass in the grid, counted from its first point; number of
    nodes; nodes about the centre; radius of the sphere around them; points of the grid along x, y, z; distances, x
    fastest.
    """
    h = field.spacing
    scaled = (nodes - properties.center) / h
    lines = [
        f"{properties.volume / h**3:.9g}",
        _text(np.diagonal(properties.inertia) / h**5),
        _text((properties.center - field.origin) / h),
        str(len(nodes)),
        _text(scaled.ravel(), "{:.6g}"),
        f"{np.linalg.norm(scaled, axis=1).max():.9g}",
        " ".join(map(str, field.values.shape[::-1])),
        _text(field.values.ravel() / h, "{:.6g}"),
    ]
    _write_lines(path, lines)


def write_lammps_grid(path: str | Path, field: LevelSet, properties: MassProperties, label: int) -> None:
    """Write a level set for LAMMPS, mm: points along x y z, spacing, first point about the centre, distances."""
    head = [
        f"# level set of grain {label}, mm, negative inside, frame of the body, {made_by()}",
        " ".join(map(str, field.values.shape[::-1])),
        f"{field.spacing:.9g}",
        _text(field.origin - properties.center),
    ]
    _write_lines(path, [*head, *map("{:.6g}".format, field.values.ravel())])


def write_clump(path: str | Path, clump: Clump, label: int) -> None:
    """Write the spheres of a clump, one ``x y z r`` a line, mm; lines that begin with # are comments."""
    head = [
        "#format x_y_z_r",
        f"# clump of grain {label}: mm, frame of the body, {made_by()}",
        f"# density, over the grain's, for its mass: {clump.density_scale:.6g}; where a code adds up all spheres: "
        f"{clump.density_scale_of_sum:.6g}",
    ]
    spheres = np.column_stack([clump.centers, clump.radii])
    _write_lines(path, [*head, *(_text(row) for row in spheres)])


def _text(values: Iterable[float], form: str = "{:.9g}") -> str:
    return " ".join(map(form.format, values))


def _write_lines(path: str | Path, lines: Iterable[str]) -> None:
    with atomic_write(path) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
