"""The folder ``dem`` of a run: shapes of all grains, and their places, orientations and velocities in all states.

Grains are made and written one at a time; only their numbers stay in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Progress
from grainmotion.grain_shapes.harmonics import orders
from grainmotion.grain_shapes.level_set import surface_nodes
from grainmotion.grain_shapes.mass_properties import MassProperties, mass_properties
from grainmotion.grain_shapes.poses import Poses, State, pose_table, poses
from grainmotion.grain_shapes.rigid_body import RigidBody
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.io.dem_scripts import YADE_SCRIPT, readme
from grainmotion.io.dem_shapes import (
    made_by,
    write_clump,
    write_lammps_grid,
    write_level_set_npz,
    write_ls_dem_grain,
    write_stl,
)
from grainmotion.io.files import atomic_write

if TYPE_CHECKING:
    import pandas as pd

BODY_FRAME = "frame of the body: origin at the centre of its volume, axes of inertia, smallest moment first"
GRAINS_CSV, POSES_CSV, HARMONICS_CSV, CLUMPS_CSV = "grains.csv", "poses.csv", "harmonics.csv", "clumps.csv"
README_TXT, YADE_PY = "README.txt", "yade_level_sets.py"
OWN_FILES = (
    "stl/grain_*.stl", "level-set/grain_*.npz", "lammps/grain_*.txt", "clumps/grain_*.txt", "ls-dem/*_*.dat",
    GRAINS_CSV, POSES_CSV, HARMONICS_CSV, CLUMPS_CSV, YADE_PY, README_TXT,
)  # fmt: skip


@dataclass
class _Written:
    """What is known of the grains that are written."""

    rows: list[dict[str, object]] = field(default_factory=list)
    properties: dict[int, MassProperties] = field(default_factory=dict)
    harmonics: list[pd.DataFrame] = field(default_factory=list)
    spheres: list[pd.DataFrame] = field(default_factory=list)


def grain_name(label: int) -> str:
    """Name of a grain in the names of files."""
    return f"grain_{label:05d}"


def write_dem_folder(
    folder: Path,
    bodies: Iterable[RigidBody],
    states: Sequence[State],
    settings: DemSettings,
    *,
    progress: Progress | None = None,
    count: int = 0,
) -> list[Path]:
    """Write all files of the folder.

    Parameters
    ----------
    folder : Path
        Made if it is missing.  Files of an older export in it are removed; others are left.
    bodies : iterable of RigidBody
        Made one at a time.
    states : sequence of State
        Later states in their order.
    settings : DemSettings
        What is written.
    progress : callable, optional
        Called as ``progress(message, done, total)``.
    count : int
        Number of bodies, for the progress.

    Returns
    -------
    list of Path
        The files.
    """
    import pandas as pd  # takes half a second and 60 MB

    for path in _own_files(folder):  # its grains and shapes may be others
        path.unlink()
    written = _Written()
    for k, body in enumerate(bodies):
        if progress is not None:
            progress("shapes of grains", k, count)
        _write_shapes(folder, body, settings)
        written.rows.append(_row(body))
        if body.properties is not None:
            written.properties[body.label] = body.properties
        _collect(body, written)
    found = poses(written.properties, states)
    grains = pd.DataFrame(written.rows)
    _write_table(folder / GRAINS_CSV, grains)
    inertia = grains[["label", "volume", "i1", "i2", "i3"]]
    _write_table(folder / POSES_CSV, pose_table(found).merge(inertia, on="label", how="left"))
    if written.harmonics:
        _write_table(folder / HARMONICS_CSV, pd.concat(written.harmonics))
    if written.spheres:
        _write_table(folder / CLUMPS_CSV, pd.concat(written.spheres))
    if "level-set" in settings.shapes:
        spacing = settings.spacing * float(written.rows[0]["voxel_size"]) if written.rows else 1.0  # type: ignore[arg-type]
        if "ls-dem" in settings.codes:
            for p in found:
                _write_ls_dem_poses(folder / "ls-dem", p, spacing)
        if "yade" in settings.codes:
            _write_text(folder / YADE_PY, YADE_SCRIPT)
    _write_text(folder / README_TXT, readme(made_by(), settings))
    return _own_files(folder)


def _own_files(folder: Path) -> list[Path]:
    """The files of an export that are in the folder."""
    return sorted(path for pattern in OWN_FILES for path in folder.glob(pattern))


def _write_shapes(folder: Path, body: RigidBody, settings: DemSettings) -> None:
    """The files of one grain."""
    if body.surface is None:
        return
    name, own = grain_name(body.label), mass_properties(body.surface)
    if "stl" in settings.shapes:
        write_stl(folder / "stl" / f"{name}.stl", body.surface, f"grain {body.label}, frame of the body")
    if body.level_set is not None:
        nodes = surface_nodes(body.surface, body.level_set.spacing)
        if "yade" in settings.codes:
            write_level_set_npz(folder / "level-set" / f"{name}.npz", body.level_set, nodes, body.label)
        if "ls-dem" in settings.codes:
            write_ls_dem_grain(folder / "ls-dem" / f"morphology_{body.label}.dat", body.level_set, nodes, own)
        if "lammps" in settings.codes:
            write_lammps_grid(folder / "lammps" / f"{name}.txt", body.level_set, own, body.label)
    if body.clump is not None:
        write_clump(folder / "clumps" / f"{name}.txt", body.clump, body.label)


def _row(body: RigidBody) -> dict[str, object]:
    """The row of ``grains.csv``."""
    nan = float("nan")
    row: dict[str, object] = {"label": body.label, "voxel_size": body.voxel_size}
    names = (
        "volume",
        "x",
        "y",
        "z",
        "i1",
        "i2",
        "i3",
        "ixx",
        "iyy",
        "izz",
        "iyz",
        "ixz",
        "ixy",
        "qw",
        "qx",
        "qy",
        "qz",
    )
    numbers = np.full(len(names), nan)
    if body.properties is not None:
        p = body.properties
        place = poses({body.label: p}, [])[0]
        tensor = p.inertia[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        numbers = np.concatenate([[p.volume], p.center, p.principal_moments, tensor, place.quaternions[0]])
    row |= dict(zip(names, numbers.tolist(), strict=True))
    surface, clump, expansion = body.in_sample, body.clump, body.harmonics
    extent = nan if body.surface is None else float(np.linalg.norm(body.surface.vertices, axis=1).max())
    row |= {"area": nan if surface is None else surface.area, "radius": extent}
    row |= {"triangles": 0 if surface is None else len(surface.faces)}
    row |= {"euler_characteristic": "" if surface is None else surface.euler_characteristic}
    row |= {"surface_from": "" if surface is None else surface.source}
    row |= {"other_pieces": nan if surface is None else surface.other_pieces, "touches_border": body.touches_border}
    row |= {"spheres": 0 if clump is None else len(clump)}
    row |= {"clump_volume_error": nan if clump is None else clump.volume_error}
    row |= {"clump_density": nan if clump is None else clump.density_scale}
    row |= {"clump_density_of_sum": nan if clump is None else clump.density_scale_of_sum}
    row |= {"harmonics_residual": nan if expansion is None else expansion.residual}
    row |= {"harmonics_worst": nan if expansion is None else expansion.worst, "reason": body.reason}
    return row


def _collect(body: RigidBody, written: _Written) -> None:
    """Coefficients and spheres of a grain."""
    import pandas as pd  # takes half a second and 60 MB

    if body.harmonics is not None and body.harmonics.star_shaped:
        degrees, m = orders(body.harmonics.degree)
        columns = {"label": body.label, "l": degrees, "m": m, "a": body.harmonics.coefficients}
        written.harmonics.append(pd.DataFrame(columns))
    if body.clump is not None:
        places = dict(zip("xyz", body.clump.centers.T, strict=True))
        written.spheres.append(pd.DataFrame({"label": body.label, **places, "r": body.clump.radii}))


def _write_ls_dem_poses(folder: Path, p: Poses, spacing: float) -> None:
    """Labels, positions (in spacings) and quaternions of the bodies whose place is a result to use, one a line."""
    known = np.isfinite(p.positions).all(axis=1) & np.isfinite(p.matrices).all(axis=(1, 2)) & p.ok_translation
    w, x, y, z = p.quaternions[known].T
    rows = {
        "labels": p.labels[known][:, None],
        "positions": p.positions[known] / spacing,
        "rotations": np.column_stack([y, -x, -z, w]),
    }
    for name, values in rows.items():
        _write_text(folder / f"{name}_{p.state}.dat", "".join(" ".join(f"{v:.9g}" for v in r) + "\n" for r in values))


def _write_table(path: Path, table: pd.DataFrame) -> None:
    """A CSV file; ``README.txt`` and the data package of the run tell units and meanings of its columns."""
    with atomic_write(path) as part:
        table.to_csv(part, index=False, float_format="%.9g")


def _write_text(path: Path, text: str) -> None:
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
