"""Texts that go with the files for DEM codes: a script for YADE, and what each file is."""

from __future__ import annotations

from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.io.dem_columns import DEM_GRAIN_COLUMNS, HARMONIC_COLUMNS, POSE_COLUMNS, SPHERE_COLUMNS

YADE_SCRIPT = '''\
# Level-set bodies of grainmotion in YADE (built with LS_DEM): run it with yade, in this folder.
# Lengths become metres, the z axis is up.  STATE is a name in the column "state" of poses.csv.
import csv
import os
import numpy as np
from yade import *

STATE = os.environ.get("STATE", "reference")
METRE = 1e-3  # 1 mm
O.materials.append(FrictMat(density=2650, young=5e9, poisson=0.3, frictionAngle=0.5, label="grain"))


def grain_bodies(state):
    """A body for each grain whose place in the state is a result to use, by its label."""
    found = {}
    with open("poses.csv") as file:
        for row in csv.DictReader(file):
            name = "level-set/grain_%05d.npz" % int(row["label"])
            if row["state"] != state:
                continue
            if row["ok_translation"] != "True" or row["x"] == "" or row["qw"] == "" or not os.path.exists(name):
                print("grain", row["label"], "is left out:", row["status"])
                continue
            data = np.load(name)
            grid = RegularGrid(
                min=Vector3(*[float(c) * METRE for c in data["minimum"]]),
                nGP=Vector3i(*[int(n) for n in data["distance"].shape]),
                spacing=float(data["spacing"]) * METRE,
            )
            options = dict(
                grid=grid,
                distField=(data["distance"].astype(float) * METRE).tolist(),
                center=Vector3(*[float(row[c]) * METRE for c in ("x", "y", "z")]),
                orientation=Quaternion(*[float(row[c]) for c in ("qw", "qx", "qy", "qz")]),
                material="grain",
            )
            nodes = [Vector3(*(node * METRE)) for node in data["nodes"]]
            try:
                found[int(row["label"])] = levelSetBody(surfNodes=nodes, **options)
            except TypeError:  # a YADE that places the nodes itself
                found[int(row["label"])] = levelSetBody(nSurfNodes=len(nodes), **options)
    return found


bodies = grain_bodies(STATE)
ids = {label: O.bodies.append(body) for label, body in bodies.items()}
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_LevelSet_Aabb()], verletDist=0),
    InteractionLoop(
        [Ig2_LevelSet_LevelSet_ScGeom()],
        [Ip2_FrictMat_FrictMat_FrictPhys()],
        [Law2_ScGeom_FrictPhys_CundallStrack(sphericalBodies=False)],
    ),
    NewtonIntegrator(damping=0.2, gravity=(0, 0, -9.81)),
]
'''

README_HEAD = """\
Grains as rigid bodies for DEM codes, written by {made_by}; docs/dem.md has more.

Lengths in mm. The frame of a body has its origin at the centre of the grain's volume and its axes along the
principal axes of inertia, smallest moment first. The sample frame is right-handed, z up along the rotation axis.
A point X of the body is at R X + x in a state: x y z and the quaternion of R are in poses.csv.

grains.csv      volume, centre, inertia, shapes made and why one is missing; one row a grain, density 1
poses.csv       place, orientation and velocity of each grain in each state; one row a state and grain"""

ABOUT_YADE = """\
level-set/      .npz: distance (nx, ny, nz), mm, negative inside; minimum, spacing and surface nodes, mm
yade_level_sets.py  makes YADE bodies of them: STATE=step-01 yade yade_level_sets.py"""

ABOUT_LS_DEM = """\
ls-dem/         morphology_LABEL.dat, and labels_, positions_ and rotations_STATE.dat with a line a grain whose
                place in the state is a result to use.
                Unit of length: the spacing of the grid, {spacing:g} voxels (voxel_size in grains.csv).
                The k-th line of positions and rotations belongs to the label in the k-th line of labels_STATE.dat.
                Codes that read Morphologies/morph_1.dat, morph_2.dat, ... take them in that order; in this folder:
                mkdir -p InitState Morphologies; cp positions_STATE.dat rotations_STATE.dat InitState; k=0
                while read n; do k=$((k+1)); cp morphology_$n.dat Morphologies/morph_$k.dat; done < labels_STATE.dat
                Lines of a morphology: mass at density 1; principal moments; centre of mass in the grid;
                number of nodes; nodes about the centre; radius; points of the grid; distances, x fastest.
                Quaternions are (y, -x, -z, w), as the LS-DEM codes of Kawamoto et al. (2016) take them."""

ABOUT_HARMONICS = """\
harmonics.csv   coefficients of spherical harmonics of star-shaped grains: radius = sum of a Y_lm(theta, phi), mm,
                frame of the body; real orthonormal Y_lm without Condon-Shortley phase, m > 0: cos(m phi),
                m < 0: sin(-m phi); theta from +z, phi from +x towards +y"""


def readme(made_by: str, settings: DemSettings) -> str:
    """What each file of the folder is."""
    lines = [README_HEAD.format(made_by=made_by)]
    level_set = settings.codes if "level-set" in settings.shapes else ()
    if "stl" in settings.shapes:
        lines.append("stl/            closed surfaces, binary STL, frame of the body")
    if "yade" in level_set:
        lines.append(ABOUT_YADE)
    if "ls-dem" in level_set:
        lines.append(ABOUT_LS_DEM.format(spacing=settings.spacing))
    if "lammps" in level_set:
        lines.append("lammps/         grid files of fix rigid/small/ls/dem, mm, about the centre of mass")
    if "clump" in settings.shapes:
        lines.append("clumps/         spheres of each grain, x y z r (LIGGGHTS, YADE); clumps.csv has all of them")
    if "harmonics" in settings.shapes:
        lines.append(ABOUT_HARMONICS)
    tables = {"grains.csv": DEM_GRAIN_COLUMNS, "poses.csv": POSE_COLUMNS}
    tables |= {"clumps.csv": SPHERE_COLUMNS} if "clump" in settings.shapes else {}
    tables |= {"harmonics.csv": HARMONIC_COLUMNS} if "harmonics" in settings.shapes else {}
    for table, columns in tables.items():
        lines += ["", f"Columns of {table}:"]
        lines += [f"  {name:<20} {unit:<10} {meaning}" for name, (unit, meaning) in columns.items()]
    return "\n".join(lines) + "\n"
