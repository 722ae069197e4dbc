"""The projector for detectors parallel to z agrees with the projector for any view."""

import numba
import numpy as np
import pytest

from grainmotion.kernels import volume_projection_vertical
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator
from volume_views import ANGLES, PANEL, SHAPE, UPRIGHT_PANELS, cone, project_any_view, volume

OFF_BORDERS = (0.05, -0.1, 0.137)  # a ray along the border between two voxels may count for either
EXACT = {"trilinear": False, "exact": True}


@pytest.mark.parametrize("projector", EXACT)
@pytest.mark.parametrize("name", UPRIGHT_PANELS)
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_agrees_with_the_projector_for_any_view(name, precision, projector):
    geometry, body = UPRIGHT_PANELS[name], volume(precision, OFF_BORDERS)
    operator = VolumeOperator(geometry, body, projector)
    assert operator.upright
    computed = operator.forward(operator.padded(body.array))
    expected = project_any_view(geometry, volume(np.float64, OFF_BORDERS), EXACT[projector])
    assert computed.dtype == precision
    single = 1.5e-5 if EXACT[projector] else 3e-6  # where a ray leaves a voxel depends on rounding, its height hardly
    tolerance = single if precision == np.float32 else 1e-7
    np.testing.assert_allclose(computed, expected, atol=tolerance * expected.max())


@pytest.mark.parametrize("projector", EXACT)
@pytest.mark.parametrize("name", UPRIGHT_PANELS)
def test_back_projection_is_the_adjoint(name, projector):
    geometry, body = UPRIGHT_PANELS[name], volume(np.float64, OFF_BORDERS)
    operator = VolumeOperator(geometry, body, projector)
    images = np.random.default_rng(1).normal(size=(len(geometry), *geometry.shape))
    back = operator.empty()
    operator.add_adjoint(images, back)
    forward = operator.forward(operator.padded(body.array))
    size = np.linalg.norm(forward) * np.linalg.norm(images)
    assert np.vdot(operator.unpadded(back), body.array) == pytest.approx(np.vdot(forward, images), abs=1e-12 * size)


@pytest.mark.parametrize("projector", EXACT)
def test_level_and_falling_rays(projector):
    """The middle row of an odd number lies in the plane of the source, rays above it rise and below it fall."""
    level = Geometry.cone(ANGLES, (41, 5), 0.4, source_to_axis=8, source_to_detector=20)
    body = volume(np.float64, OFF_BORDERS)
    operator = VolumeOperator(level, body, projector)
    assert operator.upright
    expected = project_any_view(level, body, EXACT[projector])
    np.testing.assert_allclose(operator.forward(operator.padded(body.array)), expected, atol=1e-7 * expected.max())


@pytest.mark.parametrize("projector", EXACT)
def test_volume_of_several_tiles(projector):
    """Rays that cross from tile to tile, in blocks of rows and of voxels."""
    edge, tall = 2 * volume_projection_vertical.TILE_EDGE + 5, 2 * volume_projection_vertical.TILE_ROWS + 3
    shape = (tall, edge, edge - 9)
    body = Volume(np.random.default_rng(0).uniform(size=shape), 0.1, OFF_BORDERS)
    views = Geometry.cone([3.0, 47.0, 130.0], (tall, 33), 0.8, source_to_axis=200, source_to_detector=800)
    views = Geometry(views.vectors * ([1] * 9 + [0.5] * 3), (tall, 33), "cone")
    operator = VolumeOperator(views, body, projector)
    assert operator.upright
    image = operator.padded(body.array)
    forward, expected = operator.forward(image), project_any_view(views, body, EXACT[projector])
    np.testing.assert_allclose(forward, expected, atol=1e-7 * expected.max())
    images, back = np.random.default_rng(1).normal(size=forward.shape), operator.empty()
    operator.add_adjoint(images, back)
    assert np.vdot(back, image) == pytest.approx(np.vdot(forward, images), rel=1e-9)


def test_detector_taller_than_the_volume():
    """Rows in several tiles, some of them above and below the volume."""
    rows = 2 * volume_projection_vertical.TILE_ROWS + 76
    tall = Geometry.cone(ANGLES, (rows, 3), 0.05, source_to_axis=20, source_to_detector=80)
    body = volume()
    operator = VolumeOperator(tall, body)
    assert operator.upright
    expected = project_any_view(tall, body)
    np.testing.assert_allclose(operator.forward(operator.padded(body.array)), expected, atol=3e-6 * expected.max())
    assert (expected[:, :20] == 0).all()
    assert (expected[:, volume_projection_vertical.TILE_ROWS] > 0).any()


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_voxels_outside_the_cylinder_are_ignored(beam):
    """With a radius, voxels outside the cylinder count as zero, and the projector may skip them."""
    geometry, body = UPRIGHT_PANELS[beam], volume()
    y, x = (np.arange(n) - (n - 1) / 2 for n in SHAPE[1:])
    inside = y[:, None] ** 2 + x**2 <= 5.0**2
    clipped = Volume(body.array * inside, body.voxel_size, body.center)
    operator = VolumeOperator(geometry, clipped, radius=5.0)
    expected = project_any_view(geometry, clipped)
    np.testing.assert_allclose(operator.forward(operator.padded(clipped.array)), expected, atol=3e-6 * expected.max())
    images = np.random.default_rng(1).normal(size=expected.shape)
    narrow, wide = operator.empty(), operator.empty()
    operator.add_adjoint(images, narrow)
    VolumeOperator(geometry, clipped).add_adjoint(images, wide)
    np.testing.assert_array_equal(operator.unpadded(narrow) * inside, operator.unpadded(wide) * inside)


@pytest.mark.parametrize("projector", EXACT)
@pytest.mark.parametrize("views", [1, 24])
def test_result_does_not_depend_on_the_number_of_threads(projector, views):
    operator = VolumeOperator(cone()[:views], volume(), projector)
    images = np.random.default_rng(1).normal(size=(views, *PANEL)).astype(np.float32)
    image, results = operator.padded(operator.grid.array), []
    before = numba.get_num_threads()
    for threads in (1, before):
        numba.set_num_threads(threads)
        back = operator.empty()
        operator.add_adjoint(images, back)
        results.append((back, operator.forward(image)))
    numba.set_num_threads(before)
    for one, many in zip(*results, strict=True):
        np.testing.assert_array_equal(one, many)
