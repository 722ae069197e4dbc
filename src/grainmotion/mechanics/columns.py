"""Columns of the tables of mechanics: units and meanings."""

from __future__ import annotations

from grainmotion.model.described_table import Columns, frozen, vector_columns
from grainmotion.model.strain import STRAIN_NAMES

_TENSOR = [a + b for a in "xyz" for b in "xyz"]
STRAINS_CONTENT = "strain of the sample at its grains, and their rotations against it"
STRAIN_MAP_COLUMNS: Columns = frozen({
    "label": ("1", "of the grain in the reference volume"),
    **{axis: ("mm", f"centre of mass in the reference, {axis}") for axis in "xyz"},
    **{f"F{ab}": ("1", "deformation gradient F of the sample, row and column") for ab in _TENSOR},
    **{f"green_{name}": ("1", "Green-Lagrange strain (F'F - I)/2, frame of the reference") for name in STRAIN_NAMES},
    **{f"sd_green_{name}": ("1", f"standard deviation of green_{name}") for name in STRAIN_NAMES},
    "volumetric": ("1", "relative change of volume det F - 1, positive for dilation"),
    "sd_volumetric": ("1", "standard deviation of volumetric"),
    "deviatoric": ("1", "change of shape: Frobenius norm of U (det F)^(-1/3) - I"),
    "sd_deviatoric": ("1", "standard deviation of deviatoric; empty where noise alone may show as much"),
    "deviatoric_noise": ("1", "root mean square of what noise alone shows as deviatoric"),
    **vector_columns("continuum_w", "deg", "rotation vector of R in F = R U"),
    **vector_columns("sd_continuum_w", "deg", "standard deviation of continuum_w"),
    **vector_columns("grain_w", "deg", "rotation vector of the grain itself; empty where it is no result to use"),
    **vector_columns("relative_w", "deg", "rotation vector of the grain after that of the sample"),
    **vector_columns("sd_relative_w", "deg", "standard deviation of relative_w"),
    "relative_angle": ("deg", "angle of relative_w"),
    "cell_volume": ("mm^3", "volume of the tetrahedra around the grain; mm^2 of triangles of a slice"),
    "at_hull": ("yes or no", "whether the grain is on the hull of the tetrahedra: F is that of one side"),
    "non_affine": ("mm", "root mean square of displacements about the local fit; empty for tetrahedra"),
    "reason": ("text", "why F is not known"),
})  # fmt: skip
_PAIR = {"label_1": ("1", "label of the first grain"), "label_2": ("1", "label of the second grain")}
CONTACTS_CONTENT = "pairs of grains that touch or nearly touch"
_CONTACT = {
    "kind": ("text", "contact, open, indeterminate, or overlap (one of the motions is wrong)"),
    "gap": ("mm", "distance of the surfaces, negative if they overlap"),
    "sd_gap": ("mm", "standard deviation of gap"),
    **vector_columns("", "mm", "place of the contact in this state"),
    **vector_columns("n", "1", "unit normal from the first grain to the second"),
    **vector_columns("branch_", "mm", "vector from the first centre of mass to the second"),
}
CONTACT_COLUMNS: Columns = frozen({**_PAIR, **_CONTACT})
CHANGES_CONTENT = "what became of contacts since the reference, and the relative motion of the grains there"
_CHANGE = {
    "change": ("text", "kept, gained, lost, open (in neither), indeterminate, overlap, or unknown (no motion to use)"),
    "gap_reference": ("mm", "distance of the surfaces in the reference; empty if they were not near"),
    "gap_state": ("mm", "distance of the surfaces in this state; empty if they are not near"),
    "normal_displacement": ("mm", "relative displacement at the contact along the normal, positive when grains part"),
    "sd_normal_displacement": ("mm", "standard deviation of normal_displacement"),
    **vector_columns("sliding_", "mm", "relative displacement across the normal, of the second grain over the first"),
    "sliding": ("mm", "length of the sliding vector"),
    "sd_sliding": ("mm", "standard deviation along the sliding vector"),
    "rolling": ("deg", "angle of the relative rotation across the normal"),
    "sd_rolling": ("deg", "standard deviation of rolling"),
    "twisting": ("deg", "relative rotation about the normal, of the second grain"),
    "sd_twisting": ("deg", "standard deviation of twisting"),
}
CHANGE_COLUMNS: Columns = frozen({**_PAIR, **_CHANGE})
STATE_CONTACT_COLUMNS: Columns = frozen({
    **_PAIR, **_CHANGE, **{name: column for name, column in _CONTACT.items() if name != "gap"}
})  # fmt: skip
"""Columns of ``contacts.csv`` of a state: `CHANGE_COLUMNS`, then those of the state's contacts."""
BODY_CONTACTS_CONTENT = "grains that touch or nearly touch a piston, a wall or another body beside them"
BODY_CONTACT_COLUMNS: Columns = frozen({
    "label": ("1", "label of the grain"),
    "body": ("text", "name of the body, as in bodies.csv"),
    "kind": ("text", "contact, open, indeterminate, or overlap (one of the motions is wrong)"),
    "gap": ("mm", "distance of the surfaces, negative if they overlap"),
    "sd_gap": ("mm", "standard deviation of gap"),
    **vector_columns("", "mm", "place of the contact in this state"),
    **vector_columns("n", "1", "unit normal from the grain to the body"),
})  # fmt: skip
VOIDS_CONTENT = "space around each grain"
VOID_COLUMNS: Columns = frozen(
    {
        "label": ("1", "of the grain in the reference volume"),
        "grain_volume": ("mm^3", "of the grain: voxels above half of its typical attenuation, the same in every state"),
        "cell_volume": ("mm^3", "of its Voronoi cell in this state"),
        "inside": ("yes or no", "whether neither the border of the field nor a free surface cuts the cell"),
        "void_ratio": ("1", "(cell_volume - grain_volume)/grain_volume; empty for cells that are cut"),
        "sd_void_ratio": (
            "1",
            "standard deviation of void_ratio by the translations of the grains; 0 in the reference",
        ),
    }
)
