"""Units and meanings of the columns of the tables in the folder ``dem``."""

from __future__ import annotations

from grainmotion.model.described_table import Columns, frozen, vector_columns

LABEL = ("1", "of the grain in the reference volume")
DEM_GRAIN_COLUMNS: Columns = frozen({
    "label": LABEL,
    "voxel_size": ("mm", "of the reference volume"),
    "volume": ("mm^3", "of the grain; its mass at density 1"),
    **{axis: ("mm", f"centre of the volume in the reference state, sample frame, {axis}") for axis in "xyz"},
    **{f"i{k}": ("mm^5", f"principal moment of inertia {k} of 3 at density 1, smallest first") for k in (1, 2, 3)},
    **{
        f"i{pair}": ("mm^5", f"inertia tensor about the centre at density 1, sample frame, {pair}")
        for pair in ("xx", "yy", "zz", "yz", "xz", "xy")
    },
    **{
        f"q{part}": ("1", f"quaternion from the body's frame to the sample frame in the reference state, {part}")
        for part in "wxyz"
    },
    "area": ("mm^2", "of the surface"),
    "radius": ("mm", "of the sphere about the centre that holds the grain"),
    "triangles": ("1", "number of triangles of the surface"),
    "euler_characteristic": ("1", "of the surface: 2 without holes through the grain"),
    "surface_from": ("text", "attenuation, or labels where the volume is an image of labels"),
    "other_pieces": ("1", "volume of loose pieces that are left out, over that of the whole"),
    "touches_border": ("yes or no", "whether the field of view may cut the grain"),
    "spheres": ("1", "number of spheres of the clump"),
    "clump_volume_error": ("1", "volume of the clump over that of the grain, minus 1"),
    "clump_density": ("1", "density of the clump, over the grain's, at which it has the grain's mass"),
    "clump_density_of_sum": ("1", "the same for codes that add up the masses of all spheres"),
    "harmonics_residual": ("mm", "root mean square of what the spherical harmonics miss of the radius"),
    "harmonics_worst": ("mm", "the largest of it"),
    "reason": ("text", "why a shape is missing"),
})  # fmt: skip
POSE_COLUMNS: Columns = frozen({
    "state": ("text", "name of the state; reference for the reference"),
    "time": ("s", "since the reference scan, where the state has one"),
    "label": LABEL,
    **{axis: ("mm", f"centre of the volume, {axis}") for axis in "xyz"},
    **{f"q{part}": ("1", f"quaternion from the body's frame to the sample frame, {part}") for part in "wxyz"},
    **vector_columns("r", "deg", "the same as a rotation vector"),
    **vector_columns("v", "mm", "velocity of the centre since the state before, per velocity_per"),
    **vector_columns("spin_", "deg", "angular velocity since the state before, per velocity_per"),
    "velocity_per": ("text", "s, or step from one state to the next"),
    "status": ("text", "of the grain in this state"),
    "ok_translation": ("yes or no", "whether the place is a result to use"),
    "ok_rotation": ("yes or no", "whether the orientation is a result to use"),
    "volume": ("mm^3", "of the grain; its mass at density 1"),
    **{f"i{k}": ("mm^5", f"principal moment of inertia {k} of 3 at density 1, axes of the body") for k in (1, 2, 3)},
})  # fmt: skip
HARMONIC_COLUMNS: Columns = frozen({
    "label": LABEL, "l": ("1", "degree"), "m": ("1", "order"), "a": ("mm", "coefficient"),
})  # fmt: skip
SPHERE_COLUMNS: Columns = frozen({
    "label": LABEL, **{axis: ("mm", f"centre of the sphere, body's frame, {axis}") for axis in "xyz"},
    "r": ("mm", "radius"),
})  # fmt: skip
