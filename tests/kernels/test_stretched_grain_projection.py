"""Projection of grains that are stretched before they rotate: mass, derivatives, and grains without strain."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from grainmotion.backends.cpu import CPU
from grainmotion.kernels import stretched_grain_projection
from grainmotion.kernels.layout import ViewTable
from grainmotion.model.geometry import Geometry
from grainmotion.model.pose import Pose
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.rotations import rotation_matrix

PACKED = GrainArrays.of(few_grains.smooth_grains())
GRAINS = replace(PACKED, images=PACKED.images.astype(float))
GEOMETRIES = {
    "cone": few_grains.geometry([10.0, 75.0]),
    "parallel": Geometry.parallel((10.0, 75.0), few_grains.PANEL, few_grains.VOXEL),
}
POSE = Pose(np.array([[0.03, -0.02, 0.01], [0.0, 0.05, -0.04]]), rotation_matrix([[0.1, 0.2, -0.1], [0.0, -0.2, 0.3]]))
STRETCHES = np.eye(3) + np.array(
    [[[0.08, 0.03, -0.02], [0.03, -0.05, 0.04], [-0.02, 0.04, 0.02]], [[-0.06, 0, 0.05], [0, 0.1, 0], [0.05, 0, 0.03]]]
)
UNITS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
every_geometry = pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES)
every_projector = pytest.mark.parametrize("exact", [False, True], ids=["trilinear", "exact"])


def views_of(geometry):
    return ViewTable(geometry.vectors, geometry.beam == "cone", np.array(geometry.shape))


def projected(stretches, pose, geometry, patches, exact=False):
    return CPU.project(GRAINS.stretched(stretches).table(pose), views_of(geometry), patches.table, exact)


@every_geometry
@every_projector
def test_grains_without_strain_are_projected_as_rigid_ones(geometry, exact):
    unstrained = GRAINS.stretched(np.tile(np.eye(3), (2, 1, 1)))
    patches = footprint_patches(GRAINS, POSE, geometry)
    tables = views_of(geometry), patches.table, exact
    for stretched, rigid in zip(
        CPU.project_with_derivatives(unstrained.table(POSE), *tables),
        CPU.project_with_derivatives(GRAINS.table(POSE), *tables),
        strict=True,
    ):
        np.testing.assert_allclose(stretched, rigid, atol=1e-9 * np.abs(rigid).max())


@every_geometry
def test_derivatives_by_motion_and_strain_are_the_limits_of_differences(geometry):
    """Steps are so short that hardly a ray passes a voxel's corner, where the trilinear image has a kink."""
    grains = GRAINS.stretched(STRETCHES)
    patches = footprint_patches(grains, POSE, geometry)
    tables = views_of(geometry), patches.table, False
    values, *parts = CPU.project_with_strain_derivatives(grains.table(POSE), *tables)
    np.testing.assert_allclose(values, CPU.project(grains.table(POSE), *tables), atol=1e-12)
    step = 1e-7
    for k, derivative in enumerate(np.concatenate(parts)):
        ends = []
        for sign in (1, -1):
            increment, stretches = np.zeros(6), STRETCHES.copy()
            if k < 6:
                increment[k] = sign * step
            else:
                i, j = UNITS[k - 6]
                stretches[:, [i, j], [j, i]] += sign * step
                if i == j:
                    stretches[:, i, i] = STRETCHES[:, i, i] + sign * step
            pose = Pose(POSE.translations + increment[:3], rotation_matrix(increment[3:]) @ POSE.matrices)
            ends.append(projected(stretches, pose, geometry, patches))
        wrong = np.abs((ends[0] - ends[1]) / (2 * step) - derivative) > 1e-6 * np.abs(derivative).max()
        assert np.abs(derivative).max() > 0.1
        assert wrong.mean() < 2e-3


@every_projector
def test_a_stretch_keeps_the_mass_of_a_grain(exact):
    """In a parallel beam the sum of a radiograph is the mass, whatever the shape."""
    geometry = GEOMETRIES["parallel"]
    sums = []
    for grains in (GRAINS, GRAINS.stretched(STRETCHES)):
        patches = footprint_patches(grains, POSE, geometry)
        sums.append(CPU.project(grains.table(POSE), views_of(geometry), patches.table, exact).sum())
    assert sums[1] == pytest.approx(sums[0], rel=2e-3)


def test_a_uniform_stretch_is_a_change_of_scale():
    """A grain 1 + e times as large at its place casts a shadow magnified about its centre, of the same mass."""
    geometry, larger = GEOMETRIES["parallel"], 1.25
    grain = GRAINS.select([0])
    pose = Pose(POSE.translations[:1], POSE.matrices[:1])
    scaled = replace(
        grain, corners=larger * grain.corners, hulls=larger * grain.hulls, voxel_size=larger * grain.voxel_size,
        images=grain.images / larger**3,
    )  # fmt: skip
    stretched = grain.stretched(larger * np.eye(3)[None])
    patches = footprint_patches(stretched, pose, geometry)
    one, other = (CPU.project(g.table(pose), views_of(geometry), patches.table, False) for g in (scaled, stretched))
    np.testing.assert_allclose(one, other, atol=1e-9 * one.max())


def test_hulls_hold_the_stretched_grain():
    stretched = GRAINS.stretched(np.tile(np.diag([1.4, 0.9, 1.2]), (2, 1, 1)))
    assert stretched.voxel_reach == pytest.approx(1.4 * GRAINS.voxel_size)
    for geometry in GEOMETRIES.values():
        own = footprint_patches(stretched, POSE, geometry)
        whole = replace(own, boxes=_whole_panel(own.boxes, geometry), jobs=_all_rows(own.boxes, geometry))
        inside, everything = (
            CPU.project(stretched.table(POSE), views_of(geometry), p.table, False).sum() for p in (own, whole)
        )
        assert inside == pytest.approx(everything, rel=1e-9)


def _whole_panel(boxes, geometry):
    whole = boxes.copy()
    whole[:, 2:] = 0, geometry.shape[0], 0, geometry.shape[1]
    return whole


def _all_rows(boxes, geometry):
    rows, columns = geometry.shape
    return np.array([(p, r, 0, columns) for p in range(len(boxes)) for r in range(rows)])


def test_pixels_of_no_run_are_left_as_they_are():
    patches = footprint_patches(GRAINS, POSE, GEOMETRIES["cone"], margin=1)
    outputs = [np.full((*shape, int(patches.offsets[-1])), 7.0) for shape in ((), (6,), (6,))]
    stretched_grain_projection.project_with_derivatives(
        GRAINS.stretched(STRETCHES).table(POSE), views_of(GEOMETRIES["cone"]), patches.table, False, *outputs
    )
    untouched = outputs[0] == 7.0
    assert untouched.any()
    assert all((o[:, untouched] == 7.0).all() for o in outputs[1:])
