"""Two walks of the same sums: upright panels against the walk for any view, on volumes of every shape."""

import numpy as np
import pytest

from grainmotion.kernels import volume_projection, volume_projection_vertical
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import MIN_VERTICAL_VIEWS, VolumeOperator, pad, padded_origin

PANEL = (21, 26)
SHAPE = (15, 18, 13)
ANGLES = np.linspace(0, 360, 24, endpoint=False) + 1.3


def cone(panel=None, **how):
    return Geometry.cone(ANGLES, PANEL, 0.4, source_to_axis=20, source_to_detector=80, panel=panel, **how)


def parallel(panel=None):
    return Geometry.parallel(ANGLES, PANEL, 0.1, panel=panel)


UPRIGHT = {
    "cone": cone(),
    "parallel": parallel(),
    "panel beside the axis": cone(DetectorAlignment(offset=(0.9, -0.6), axis_offset=0.13)),
    "panel turned about z": cone(DetectorAlignment(tilts_deg=(0, 0, 9))),
    "first row on top": cone(DetectorAlignment(first_row="top")),
}


def volume(precision=np.float32, center=(0.05, -0.1, 0.15)):
    rng = np.random.default_rng(0)
    return Volume(rng.uniform(size=SHAPE).astype(precision), 0.1, center)


def anyhow(geometry, body):
    """A x by the walk for any view."""
    out = np.empty((len(geometry), *geometry.shape), body.array.dtype)
    cone = geometry.beam == "cone"
    volume_projection.forward(pad(body.array), padded_origin(body), body.voxel_size, geometry.vectors, cone, False, out)
    return out


@pytest.mark.parametrize("name", UPRIGHT)
@pytest.mark.parametrize(("precision", "tolerance"), [(np.float32, 3e-6), (np.float64, 1e-7)])
def test_upright_walk_is_the_walk_for_any_view(name, precision, tolerance):
    geometry, body = UPRIGHT[name], volume(precision)
    operator = VolumeOperator(geometry, body)
    assert operator.upright
    found, expected = operator.forward(operator.padded(body.array)), anyhow(geometry, body)
    assert found.dtype == precision
    np.testing.assert_allclose(found, expected, atol=tolerance * expected.max())


@pytest.mark.parametrize("name", UPRIGHT)
def test_adjoint(name):
    geometry, body = UPRIGHT[name], volume(np.float64)
    operator = VolumeOperator(geometry, body)
    images = np.random.default_rng(1).normal(size=(len(geometry), *PANEL))
    back = operator.empty()
    operator.add_adjoint(images, back)
    forward = operator.forward(operator.padded(body.array))
    assert np.vdot(operator.unpadded(back), body.array) == pytest.approx(np.vdot(forward, images), rel=1e-6)


def test_adjoint_adds_and_takes_some_views():
    geometry, body = UPRIGHT["cone"], volume(np.float64)
    operator, views = VolumeOperator(geometry, body), np.array([3, 17, 4])
    images = np.random.default_rng(1).normal(size=(3, *PANEL))
    some, every = operator.empty(), np.zeros((len(geometry), *PANEL))
    operator.add_adjoint(images, some, views)
    operator.add_adjoint(images, some, views)
    every[views] = 2 * images
    whole = operator.empty()
    operator.add_adjoint(every, whole)
    np.testing.assert_allclose(operator.unpadded(some), operator.unpadded(whole), atol=1e-12)
    image = operator.padded(body.array)
    np.testing.assert_array_equal(operator.forward(image, views), operator.forward(image)[views])


def test_tall_panel():
    """Rows in several tiles, some of them above and below the volume."""
    rows = 2 * volume_projection_vertical.ROWS_AT_ONCE + 76
    tall = Geometry.cone(ANGLES, (rows, 3), 0.01, source_to_axis=20, source_to_detector=80)
    body = volume()
    operator = VolumeOperator(tall, body)
    assert operator.upright
    expected = anyhow(tall, body)
    np.testing.assert_allclose(operator.forward(operator.padded(body.array)), expected, atol=3e-6 * expected.max())
    assert (expected[:, :20] == 0).all()
    assert (expected[:, volume_projection_vertical.ROWS_AT_ONCE] > 0).any()


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_cylinder(beam):
    """With a radius, what lies beyond its cylinder counts as zero: the walk may pass over it."""
    geometry, body = UPRIGHT[beam], volume()
    y, x = (np.arange(n) - (n - 1) / 2 for n in SHAPE[1:])
    inside = y[:, None] ** 2 + x**2 <= 5.0**2
    clipped = Volume(body.array * inside, body.voxel_size, body.center)
    operator = VolumeOperator(geometry, clipped, radius=5.0)
    expected = anyhow(geometry, clipped)
    np.testing.assert_allclose(operator.forward(operator.padded(clipped.array)), expected, atol=3e-6 * expected.max())
    images = np.random.default_rng(1).normal(size=expected.shape)
    narrow, wide = operator.empty(), operator.empty()
    operator.add_adjoint(images, narrow)
    VolumeOperator(geometry, clipped).add_adjoint(images, wide)
    np.testing.assert_array_equal(operator.unpadded(narrow) * inside, operator.unpadded(wide) * inside)


class TestChoice:
    """Only what the upright walk computes alike is given to it."""

    @pytest.mark.parametrize(
        "panel",
        [
            DetectorAlignment(tilts_deg=(0.1, 0, 0)),
            DetectorAlignment(tilts_deg=(0, 0.1, 0)),
            DetectorAlignment(axis_tilt_deg=(0.1, 0)),
        ],
    )
    def test_tilted_panels(self, panel):
        operator = VolumeOperator(cone(panel), volume())
        assert not operator.upright
        found = operator.forward(operator.padded(operator.grid.array))
        np.testing.assert_array_equal(found, anyhow(cone(panel), volume()))

    def test_the_exact_path(self):
        assert not VolumeOperator(cone(), volume(), "exact").upright

    def test_few_views(self):
        assert not VolumeOperator(cone()[: MIN_VERTICAL_VIEWS - 1], volume()).upright

    def test_rays_steeper_than_45_degrees(self):
        near = Geometry.cone(ANGLES, (200, 10), 0.4, source_to_axis=8, source_to_detector=32)
        assert not VolumeOperator(near, volume()).upright

    def test_laying_and_back(self):
        for geometry in (cone(), cone(DetectorAlignment(tilts_deg=(1, 0, 0)))):
            operator = VolumeOperator(geometry, volume())
            laid = operator.padded(operator.grid.array)
            assert laid.shape == operator.empty().shape
            np.testing.assert_array_equal(operator.unpadded(laid), operator.grid.array)
            inner = operator.by_height(laid)[2:-2, 2:-2, 2:-2]
            np.testing.assert_array_equal(inner, operator.grid.array.transpose(1, 2, 0))


def test_the_same_whatever_the_threads():
    import numba

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
