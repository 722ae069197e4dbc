"""The linear operator of a volume's projection: choice of the projector, padding, and parts of the views."""

import numpy as np
import pytest

from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.projection.volume_operator import MIN_VERTICAL_VIEWS, VolumeOperator
from volume_views import ANGLES, PANEL, UPRIGHT_PANELS, cone, project_any_view, volume


def test_adjoint_adds_and_takes_some_views():
    geometry, body = UPRIGHT_PANELS["cone"], volume(np.float64)
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


class TestChoice:
    """The projector for panels parallel to z serves only views that it projects as the one for any view does."""

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
        computed = operator.forward(operator.padded(operator.grid.array))
        np.testing.assert_array_equal(computed, project_any_view(cone(panel), volume()))

    def test_the_exact_path(self):
        assert not VolumeOperator(cone(), volume(), "exact").upright

    def test_few_views(self):
        assert not VolumeOperator(cone()[: MIN_VERTICAL_VIEWS - 1], volume()).upright

    def test_rays_steeper_than_45_degrees(self):
        near = Geometry.cone(ANGLES, (200, 10), 0.4, source_to_axis=8, source_to_detector=32)
        assert not VolumeOperator(near, volume()).upright

    def test_padding_and_back(self):
        for geometry in (cone(), cone(DetectorAlignment(tilts_deg=(1, 0, 0)))):
            operator = VolumeOperator(geometry, volume())
            padded = operator.padded(operator.grid.array)
            assert padded.shape == operator.empty().shape
            np.testing.assert_array_equal(operator.unpadded(padded), operator.grid.array)
            inner = operator.by_height(padded)[2:-2, 2:-2, 2:-2]
            np.testing.assert_array_equal(inner, operator.grid.array.transpose(1, 2, 0))
