"""`VolumeOperator`: choice of the projector, padding, and projection of selected views."""

import numpy as np
import pytest

from grainmotion.kernels import volume_projection_vertical
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.projection.volume_operator import VolumeOperator
from volume_views import ANGLES, PANEL, UPRIGHT_PANELS, cone, project_any_view, volume


def test_adjoint_of_selected_views_is_added():
    geometry, body = UPRIGHT_PANELS["cone"], volume(np.float64)
    operator, views = VolumeOperator(geometry, body), np.array([3, 17, 4])
    images = np.random.default_rng(1).normal(size=(3, *PANEL))
    selected, all_images = operator.empty(), np.zeros((len(geometry), *PANEL))
    operator.add_adjoint(images, selected, views)
    operator.add_adjoint(images, selected, views)
    all_images[views] = 2 * images
    whole = operator.empty()
    operator.add_adjoint(all_images, whole)
    np.testing.assert_allclose(operator.unpadded(selected), operator.unpadded(whole), atol=1e-12)
    image = operator.padded(body.array)
    np.testing.assert_array_equal(operator.forward(image, views), operator.forward(image)[views])
    kernels = volume_projection_vertical.forward, volume_projection_vertical.adjoint
    assert not any(signature[3].mutable for kernel in kernels for signature in kernel.signatures)  # some views as all


class TestProjectorChoice:
    """The projector for detectors parallel to z is used only where it agrees with the one for any view."""

    @pytest.mark.parametrize(
        "panel",
        [
            DetectorAlignment(detector_tilts_deg=(0.1, 0, 0)),
            DetectorAlignment(detector_tilts_deg=(0, 0.1, 0)),
            DetectorAlignment(axis_tilt_deg=(0.1, 0)),
        ],
    )
    def test_tilted_detector_or_axis(self, panel):
        operator = VolumeOperator(cone(panel), volume())
        assert not operator.upright
        computed = operator.forward(operator.padded(operator.grid.array))
        np.testing.assert_array_equal(computed, project_any_view(cone(panel), volume()))

    @pytest.mark.parametrize(("projector", "views"), [("trilinear", 24), ("exact", 24), ("trilinear", 1)])
    def test_upright_panels(self, projector, views):
        assert VolumeOperator(cone()[:views], volume(), projector).upright

    @pytest.mark.parametrize("pixel", [0.02, 2.0])
    def test_neighbouring_rays_far_less_or_more_than_a_voxel_apart(self, pixel):
        geometry = Geometry.cone(ANGLES, (4, 4), pixel, source_to_axis=20, source_to_detector=80)
        assert not VolumeOperator(geometry, volume()).upright

    def test_source_inside_the_volume(self):
        within = Geometry.cone(ANGLES, (4, 4), 0.4, source_to_axis=0.5, source_to_detector=80)
        assert not VolumeOperator(within, volume()).upright

    def test_rays_steeper_than_45_degrees(self):
        near = Geometry.cone(ANGLES, (200, 10), 0.4, source_to_axis=8, source_to_detector=32)
        assert not VolumeOperator(near, volume()).upright

    def test_unpadding_inverts_padding(self):
        for geometry in (cone(), cone(DetectorAlignment(detector_tilts_deg=(1, 0, 0)))):
            operator = VolumeOperator(geometry, volume())
            padded = operator.padded(operator.grid.array)
            assert padded.shape == operator.empty().shape
            np.testing.assert_array_equal(operator.unpadded(padded), operator.grid.array)
            inner = operator.by_height(padded)[2:-2, 2:-2, 2:-2]
            np.testing.assert_array_equal(inner, operator.grid.array.transpose(1, 2, 0))
