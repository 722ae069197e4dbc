"""Every file that a run writes, and what is in it.

``docs/files.md`` is made from it, ``datapackage.json`` of a results folder too, and a test reads the files of a run
without the package and compares.  A new file needs an entry here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from grainmotion.io.contents import ALL_HDF5, MOTION_DATASETS, REFERENCE_DATASETS
from grainmotion.io.dem_columns import DEM_GRAIN_COLUMNS, HARMONIC_COLUMNS, LABEL, POSE_COLUMNS, SPHERE_COLUMNS
from grainmotion.mechanics.columns import (
    BODY_CONTACT_COLUMNS,
    BODY_CONTACTS_CONTENT,
    CHANGES_CONTENT,
    CONTACT_COLUMNS,
    CONTACTS_CONTENT,
    STATE_CONTACT_COLUMNS,
    STRAIN_MAP_COLUMNS,
    STRAINS_CONTENT,
    VOID_COLUMNS,
    VOIDS_CONTENT,
)
from grainmotion.model.described_table import Columns, frozen, vector_columns
from grainmotion.model.motion_table import MOTION_DESCRIPTIONS, MOTIONS_CONTENT
from grainmotion.sequences.table import SERIES_COLUMNS, SERIES_STRAINS

ZARR_SUFFIX, DEM_FOLDER = ".ome.zarr", "dem"


@dataclass(frozen=True)
class FileKind:
    """One kind of file of a results folder.

    Attributes
    ----------
    path : str
        From the results folder; ``STATE`` stands for the folder of any state, ``*`` for any text.
    content : str
        What it holds.
    when : str
        When it is written.
    columns : mapping
        Of a table: unit and meaning of each column, in order; columns after those of a plain table may be missing.
    items : mapping
        Of other files: unit and meaning of each dataset, attribute or key.
    note : str
        How to read it, or what to know of it.
    """

    path: str
    content: str
    when: str = "always"
    columns: Columns = field(default_factory=dict)
    items: Columns = field(default_factory=dict)
    note: str = ""

    def matches(self, path: str) -> bool:
        """Whether a path from the results folder is of this kind; what is inside a store counts as the store."""
        path = store_of(path)
        folder, _, name = path.rpartition("/")
        own_folder, _, own_name = self.path.rpartition("/")
        return fnmatchcase(name, own_name) and (own_folder == folder or (own_folder == "STATE" and bool(folder)))


def _with_motion(more: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    return {
        **more,
        **{axis: ("mm", f"centre of mass in the reference, {axis}") for axis in "xyz"},
        **vector_columns("u", "mm", "translation of the centre"),
        **vector_columns("w", "deg", "rotation vector about the centre"),
        **vector_columns("sd_u", "mm", "standard deviation of the translation"),
        **vector_columns("sd_w", "deg", "standard deviation of the rotation"),
    }


BODY_DESCRIPTIONS: Columns = frozen(_with_motion({
    "name": ("text", "of the body"),
    "kind": ("text", "piston, wall, rest or body"),
    "freedom": ("text", "ways in which it may move"),
    "moved": ("yes or no", "whether it moved, as far as the radiographs show"),
}))  # fmt: skip
PIECE_DESCRIPTIONS: Columns = frozen(_with_motion({
    "label": ("1", "of the grain that broke"),
    "piece": ("1", "1 for the largest"),
    "status": ("text", "outcome of the fit of the piece"),
    "share": ("1", "of the grain's attenuation, so of its volume"),
}))  # fmt: skip
APPEARED_DESCRIPTIONS: Columns = frozen({
    "number": ("1", "from the highest to the lowest"),
    **{axis: ("mm", f"centre in this state, {axis}") for axis in "xyz"},
    **vector_columns("sd_", "mm", "standard deviation of the centre"),
    "radius": ("mm", "of the ball of the same volume"),
    "sd_radius": ("mm", "its standard deviation"),
    "attenuation": ("1/mm", "of the ellipsoid"),
})  # fmt: skip
PLAN_DESCRIPTIONS: Columns = frozen({
    "label": ("1", "of the grain in the reference volume"),
    **{axis: ("mm", f"centre of mass, {axis}") for axis in "xyz"},
    "views": ("1", "number of views of the set"),
    "set": ("text", "kind of the set: best, or evenly spaced"),
    **vector_columns("sd_u", "mm", "predicted standard deviation of the translation"),
    **vector_columns("sd_w", "deg", "predicted standard deviation of the rotation"),
})  # fmt: skip
ANGLE_DESCRIPTIONS: Columns = frozen({
    "views": ("1", "number of views of the set"),
    "set": ("text", "kind of the set: best, or evenly spaced"),
    "angles_deg": ("deg", "angles of the views, between spaces"),
    "surface_sd_voxel": ("voxel", "predicted standard deviation of a point of a grain's surface: what is minimised"),
    "sd_u_mm": ("mm", "median over the grains of the standard deviation of the translation"),
    "sd_u_voxel": ("voxel", "the same"),
    "sd_w_deg": ("deg", "median over the grains of the standard deviation of the rotation"),
    "worst_sd_u_voxel": ("voxel", "of the worst grain"),
    "worst_sd_w_deg": ("deg", "of the worst grain"),
    "capture": ("text", "motions from which the fit finds the right one"),
    "capture_mm": ("mm", "largest of them"),
    "room_across_mm": ("mm", "how far the sample may move across before it leaves the panel"),
    "room_along_mm": ("mm", "the same along the axis"),
})  # fmt: skip
SPAM_DESCRIPTIONS: Columns = frozen({
    "Label": ("1", "of the grain in the reference volume; 0 is the background"),
    **{f"{axis}pos": ("voxel", f"centroid of the label along {axis.lower()}, 0 at the first voxel") for axis in "ZYX"},
    **{f"{axis}disp": ("voxel", f"displacement along {axis.lower()} of the point by AboutBox") for axis in "ZYX"},
    **{f"F{i}{j}": ("1", f"deformation gradient, row {i}, column {j}") for i in "zyx" for j in "zyx"},
    "PSCC": ("1", "0"),
    "error": ("1", "residual of the grain, line integrals"),
    "iterations": ("1", "of the fit"),
    "returnStatus": ("1", "2 converged, 1 translation to use, 0 not fitted, -1 not to be used, -7 no motion"),
    **{name: ("1", "0") for name in ("deltaPhiNorm", "LabelDilate", "pixelSearchCC")},
    **{f"sd_{axis}disp": ("voxel", f"standard deviation of the displacement along {axis.lower()}") for axis in "ZYX"},
    **{f"sd_{axis}rot_deg": ("deg", f"standard deviation of the rotation about {axis.lower()}") for axis in "ZYX"},
    "AboutBox": ("1", "1 for the displacement of the middle of the label's bounding box, 0 for that of its centroid"),
    "VoxelSize_mm": ("mm", "edge of a voxel"),
})  # fmt: skip
_JSON_ABOUT = {"grainmotion": ("text", "version that wrote it"), "frame": ("text", "axes and signs")}
_FINDINGS = "a list with one object a finding: check, level, where, fact, evidence, remedy, fix"
_REFERENCE_SUMMARY = {
    **_JSON_ABOUT,
    "units": ("text", "of all numbers in it"),
    "settings": ("", "the table [mechanics]"),
    "pairs": ("1", "number of pairs of each kind of contact"),
    "contacts_with_bodies": ("1", "number of contacts with each piston, wall or other body"),
    "fabric_of_normals": ("1", "Fabric of the contact normals, see docs/mechanics.md"),
    "fabric_of_branches": ("1", "Fabric of the branch vectors"),
    "void_ratio": ("1", "mean over all cells inside, and their number"),
    "left_out": ("text", "reason of each grain that was left out, by label"),
}
_STATE_SUMMARY = {
    **_REFERENCE_SUMMARY,
    "strain": ("1", "F of the whole sample, volumetric and deviatoric strain with errors"),
    "changes": ("1", "number of pairs of each kind of change"),
}
_SPAM = '`exports` has "spam"'
_VTK = '`exports` has "vtk"'
_VTK_NOTE = "lengths in mm, sample frame; angles in degrees; see [export](export.md)"
_TIFF_NOTE = "[z, y, x], the reference's grid; the voxel size is in it as ImageJ reads it"
_ZARR_NOTE = "a folder, OME-NGFF with voxel size, [z, y, x]; labels in `labels`"
_DEM_EXPORT = '`exports` has "dem"'
_MECH = '`exports` has "mechanics"'
_DEM_NOTE = "see [dem](dem.md)"
_OWN = "attributes of the file and of each dataset say units, frame, version and settings"
FILES: tuple[FileKind, ...] = (
    FileKind("datapackage.json", "the files of this folder, their units, and the settings of the run",
             note="a Frictionless Data Package; describes the tables, whose own first line is their header"),
    FileKind("reference.h5", "reference state: volume, grains and what is beside them",
             items={**ALL_HDF5, **REFERENCE_DATASETS}, note=_OWN),
    FileKind("reconstruction.h5", "the reconstructed volume, until it is segmented", "until the segmentation is done",
             items={**ALL_HDF5, **REFERENCE_DATASETS}, note=_OWN),
    FileKind("series.h5", "load series: motions of all states", "`series` has \"h5\"",
             note="groups `states`, `grains`, `motions` with the columns of series.csv, and `covariances`; each "
             "dataset has `unit` and `meaning`; see [series](series.md)"),
    FileKind("series.csv", "load series: motions of all states, one row a state and grain", "`series` has \"csv\"",
             columns={**SERIES_COLUMNS, **SERIES_STRAINS}),
    FileKind("series.parquet", "the same table", "`series` has \"parquet\"",
             columns={**SERIES_COLUMNS, **SERIES_STRAINS}),
    FileKind("calibration.json", "corrections of the scanner, estimated from the full scan",
             "`[calibrate]` asks for any",
             items={**_JSON_ABOUT, "geometry": ("told", "corrections with value, sd and unit, residuals; or null"),
                    "hardening": ("1", "curve that undoes beam hardening: coefficients, longest, sd; or null")}),
    FileKind("beam_level.json", "level of the beam in each view of the full scan", "the beam was not constant",
             items={**_JSON_ABOUT, "unit": ("text", "of the levels"),
                    "levels": ("1", "subtracted from the line integrals of each view"),
                    "source": ("text", "air or reconstruction: what showed them")}),
    FileKind("checks*.json", "what checks of the full scan, of volume and labels noticed", "anything was noticed",
             note=_FINDINGS),
    FileKind("radiographs.json", "what was noticed in frames and grey values of the full scan",
             "anything was noticed", note=_FINDINGS),
    FileKind("stages.json", "which stages are done, and from what",
             items={"grainmotion": ("text", "version that wrote it"),
                    "stages": ("text", "fingerprint and files of each stage"),
                    "inputs": ("text", "size, time and hash of each input file")}),
    FileKind("run.log", "what each run did, with times, versions and findings", note="text"),
    FileKind("report.html", "the report on all states",
             note="one page that opens in any browser, also without network: findings, grains in 3-D and as a table "
             "(CSV), radiographs, fit, settings, and the command that makes the results again"),
    FileKind("reference.vti", "volume (1/mm) and labels for ParaView", _VTK, note=_VTK_NOTE),
    FileKind("reference_grains.vtp", "grains of the reference as points for ParaView", _VTK, note=_VTK_NOTE),
    FileKind("reference_surfaces.vtp", "grains of the reference as surfaces for ParaView", _VTK, note=_VTK_NOTE),
    FileKind("grains.pvd", "the grains of all states as points, a time step a state", _VTK, note="open it in ParaView"),
    FileKind("surfaces.pvd", "the grains of all states as surfaces, a time step a state", _VTK,
             note="open it in ParaView"),
    FileKind("reference.tif", "volume, 1/mm", "`exports` has \"spam\" or \"tiff\"", note=_TIFF_NOTE),
    FileKind("reference_labels.tif", "labels, 0 for none", "`exports` has \"spam\" or \"tiff\"", note=_TIFF_NOTE),
    FileKind("reference.ome.zarr", "volume (1/mm) and labels", "`exports` has \"ome-zarr\"", note=_ZARR_NOTE),
    FileKind("dem", "grains as rigid bodies for DEM codes: shapes, inertia, poses and velocities", _DEM_EXPORT,
             note="a folder; each file is told in [dem](dem.md), the units of its tables in README.txt"),
    FileKind("watch.html", "live page of `grainmotion watch`", "`grainmotion watch`", note="opens in any browser"),
    FileKind("reference_contacts.csv", CONTACTS_CONTENT, _MECH, columns=CONTACT_COLUMNS),
    FileKind("reference_body_contacts.csv", BODY_CONTACTS_CONTENT, _MECH, columns=BODY_CONTACT_COLUMNS),
    FileKind("reference_void_ratio.csv", VOIDS_CONTENT, _MECH, columns=VOID_COLUMNS),
    FileKind("reference_mechanics.json", "contacts, fabric and void ratio of the reference as a whole", _MECH,
             items=_REFERENCE_SUMMARY),
    FileKind("STATE/motions.csv", MOTIONS_CONTENT, columns=MOTION_DESCRIPTIONS,
             note="the last twelve columns only with `[track] strain = true`"),
    FileKind("STATE/motions.h5", f"{MOTIONS_CONTENT}, with covariances and the fit as a whole",
             items={**ALL_HDF5, **MOTION_DATASETS}, note=f"angles in **radians**; {_OWN}"),
    FileKind("STATE/residuals.tif", "measured - simulated radiographs [view, row, column]",
             note="line integrals, dimensionless; NaN where a pixel is masked; its description is JSON"),
    FileKind("STATE/checks*.json", "what checks of the state noticed", "anything was noticed", note=_FINDINGS),
    FileKind("STATE/radiographs.json", "what was noticed in frames and grey values", "anything was noticed",
             note=_FINDINGS),
    FileKind("STATE/bodies.csv", "motions of pistons, walls and other bodies", "there are bodies",
             columns=BODY_DESCRIPTIONS),
    FileKind("STATE/appeared.csv", "grains that the reference does not have", "grains appeared",
             columns=APPEARED_DESCRIPTIONS),
    FileKind("STATE/pieces.csv", "motions of the pieces of broken grains", "grains broke", columns=PIECE_DESCRIPTIONS),
    FileKind("STATE/rebuilt.tif", "the deformed volume, 1/mm", "`rebuild = true`, or `exports` has \"tiff\"",
             note=_TIFF_NOTE),
    FileKind("STATE/rebuilt_labels.tif", "labels of the moved grains, 0 for none",
             "`rebuild = true`, or `exports` has \"tiff\"", note=_TIFF_NOTE),
    FileKind("STATE/rebuilt.h5", "the deformed volume, 1/mm, and labels", "`rebuild = true`, `volumes = \"hdf5\"`",
             note="datasets `volume` and `labels` with their voxel size"),
    FileKind("STATE/rebuilt.ome.zarr", "the deformed volume, 1/mm, and labels",
             "`rebuild = true`, `volumes = \"ome-zarr\"`", note=_ZARR_NOTE),
    FileKind("STATE/grains.vtp", "grains as points for ParaView, with all columns of motions.csv", _VTK,
             note=_VTK_NOTE),
    FileKind("STATE/surfaces.vtp", "grains as surfaces for ParaView, with the same columns", _VTK, note=_VTK_NOTE),
    FileKind("STATE/grains-ddic.tsv", "motions for spam", _SPAM, columns=SPAM_DESCRIPTIONS,
             note="**voxels**, z y x, 0-based; tab-separated; see [export](export.md#spam)"),
    FileKind("STATE/strains.csv", STRAINS_CONTENT, _MECH, columns=STRAIN_MAP_COLUMNS),
    FileKind("STATE/contacts.csv", CHANGES_CONTENT, _MECH, columns=STATE_CONTACT_COLUMNS),
    FileKind("STATE/body_contacts.csv", BODY_CONTACTS_CONTENT, _MECH, columns=BODY_CONTACT_COLUMNS),
    FileKind("STATE/void_ratio.csv", VOIDS_CONTENT, _MECH, columns=VOID_COLUMNS),
    FileKind("STATE/mechanics.json", "strain, contacts, fabric and void ratio of the state as a whole", _MECH,
             items=_STATE_SUMMARY),
    FileKind("dem/grains.csv", "grains as rigid bodies: volume, inertia, which shapes were made", _DEM_EXPORT,
             columns=DEM_GRAIN_COLUMNS, note=_DEM_NOTE),
    FileKind("dem/poses.csv", "place, orientation and velocity of each body in each state", _DEM_EXPORT,
             columns=POSE_COLUMNS, note=_DEM_NOTE),
    FileKind("dem/harmonics.csv", "spherical harmonics of all star-shaped grains", _DEM_EXPORT,
             columns=HARMONIC_COLUMNS, note=_DEM_NOTE),
    FileKind("dem/clumps.csv", "spheres of all clumps", _DEM_EXPORT, columns=SPHERE_COLUMNS, note=_DEM_NOTE),
    FileKind("dem/README.txt", "what each file of this folder is", _DEM_EXPORT, note="text"),
    FileKind("dem/yade_level_sets.py", "makes YADE bodies of the level sets", _DEM_EXPORT, note="run by YADE"),
    FileKind("dem/stl/grain_*.stl", "surface of a grain, mm, body's frame", _DEM_EXPORT, note="binary STL"),
    FileKind("dem/level-set/grain_*.npz", "level set of a grain for YADE", _DEM_EXPORT,
             items={"distance": ("mm", "signed distance [x, y, z], negative inside"),
                    "minimum": ("mm", "place of the first point, body's frame"), "spacing": ("mm", "of the points"),
                    "nodes": ("mm", "points of the surface"), "label": LABEL, "made_by": ("text", "version")}),
    FileKind("dem/ls-dem/*.dat", "grains, places and orientations for LS-DEM", _DEM_EXPORT,
             note="unit of length is the spacing of the grid; see [dem](dem.md)"),
    FileKind("dem/lammps/grain_*.txt", "level set of a grain for LAMMPS, mm", '`[dem] codes` has "lammps"',
             note="see [dem](dem.md)"),
    FileKind("dem/clumps/grain_*.txt", "spheres of a clump, x y z r, mm, body's frame", _DEM_EXPORT,
             note="see [dem](dem.md)"),
    FileKind("plan/plan.csv", "predicted precision of each grain, by set of views", "`grainmotion plan`",
             columns=PLAN_DESCRIPTIONS),
    FileKind("plan/angles.csv", "sets of views with their precision and capture range", "`grainmotion plan`",
             columns=ANGLE_DESCRIPTIONS),
    FileKind("plan/plan.png", "the plan as a figure", "`grainmotion plan`"),
)  # fmt: skip
"""All kinds of files, in the order of the page."""


def store_of(path: str) -> str:
    """The path, or that of the OME-Zarr folder or of the folder for DEM codes that holds it."""
    if path.startswith(f"{DEM_FOLDER}/"):
        return DEM_FOLDER
    before, suffix, _ = path.partition(ZARR_SUFFIX)
    return before + suffix


def kind_of(path: str) -> FileKind | None:
    """The kind of a file, by its path from the results folder; None for one that no run writes."""
    return next((kind for kind in FILES if kind.matches(path)), None)
