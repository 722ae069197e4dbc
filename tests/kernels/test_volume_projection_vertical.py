"""The projector for detectors parallel to z agrees with the projector for any view."""

import numba
import numpy as np
import pytest

from grainmotion.kernels import volume_projection_vertical
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import VolumeOperator
from volume_views import ANGLES, PANEL, SHAPE, UPRIGHT_PANELS, cone, project_any_view, volume


@pytest.mark.parametrize("name", UPRIGHT_PANELS)
@pytest.mark.parametrize(("precision", "tolerance"), [(np.float32, 3e-6), (np.float64, 1e-7)])
def test_agrees_with_the_projector_for_any_view(name, precision, tolerance):
    geometry, body = UPRIGHT_PANELS[name], volume(precision)
    operator = VolumeOperator(geometry, body)
    assert operator.upright
    computed, expected = operator.forward(operator.padded(body.array)), project_any_view(geometry, body)
    assert computed.dtype == precision
    np.testing.assert_allclose(computed, expected, atol=tolerance * expected.max())


@pytest.mark.parametrize("name", UPRIGHT_PANELS)
def test_back_projection_is_the_adjoint(name):
    geometry, body = UPRIGHT_PANELS[name], volume(np.float64)
    operator = VolumeOperator(geometry, body)
    images = np.random.default_rng(1).normal(size=(len(geometry), *PANEL))
    back = operator.empty()
    operator.add_adjoint(images, back)
    forward = operator.forward(operator.padded(body.array))
    assert np.vdot(operator.unpadded(back), body.array) == pytest.approx(np.vdot(forward, images), rel=1e-6)


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


def test_result_does_not_depend_on_the_number_of_threads():
    operator = VolumeOperator(cone(), volume())
    images = np.random.default_rng(1).normal(size=(len(ANGLES), *PANEL)).astype(np.float32)
    results = []
    before = numba.get_num_threads()
    for threads in (1, before):
        numba.set_num_threads(threads)
        back = operator.empty()
        operator.add_adjoint(images, back)
        results.append(back)
    numba.set_num_threads(before)
    np.testing.assert_array_equal(*results)
