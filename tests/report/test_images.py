"""Images of the report: colours of pixels, grey scales, and averaging of large images."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from grainmotion.report import images
from grainmotion.report.images import GreyScale


def decode(url: str) -> np.ndarray:
    """RGBA pixels of a ``data:`` URL."""
    head, body = url.split(",", 1)
    assert head == "data:image/png;base64"
    return np.array(Image.open(io.BytesIO(base64.b64decode(body))).convert("RGBA"))


class TestPixels:
    def test_grey_is_black_to_white_and_nan_is_transparent(self):
        pixels = decode(images.png(np.array([[-1.0, 0.0, 1.0, 2.0, 3.0, np.nan]]), GreyScale(0.0, 2.0)))[0]
        assert [tuple(p[:3]) for p in pixels[:2]] == [(0, 0, 0), (0, 0, 0)]
        assert [tuple(p[:3]) for p in pixels[3:5]] == [(255, 255, 255), (255, 255, 255)]
        assert abs(int(pixels[2, 0]) - 127) <= 1
        assert list(pixels[:, 3]) == [255] * 5 + [0]

    def test_residuals_are_blue_white_red(self):
        low, middle, high = decode(images.png(np.array([[-1.0, 0.0, 1.0]]), GreyScale(-1.0, 1.0, "diverging")))[0]
        assert low[2] > low[0]
        assert high[0] > high[2]
        assert middle[:3].min() > 240

    def test_labels_differ_in_colour_and_background_is_transparent(self):
        pixels = decode(images.label_png(np.array([[0, 1, 2, 64]])))[0]
        assert pixels[0, 3] == 0
        assert len({tuple(p) for p in pixels}) == 4


class TestScales:
    def test_grey_scale_starts_at_zero_and_covers_all_images(self):
        ramp = np.linspace(0.1, 2.0, 1000).reshape(1, 20, 50)
        scale = images.grey_scale(ramp, 2 * ramp)
        assert scale.low == 0
        assert scale.high == pytest.approx(4.0, rel=0.01)

    def test_scale_of_residuals_is_symmetric(self):
        scale = images.diverging_scale(np.linspace(-1, 3, 1000).reshape(1, 20, 50))
        assert scale.low == -scale.high
        assert scale.high == pytest.approx(3, rel=0.01)

    @pytest.mark.parametrize("value", [0.0, 1.0, np.nan])
    def test_constant_images_have_a_valid_scale(self, value):
        flat = np.full((1, 3, 4), value)
        for scale in (images.grey_scale(flat), images.diverging_scale(flat)):
            assert scale.high > scale.low


class TestShrink:
    def test_small_images_are_unchanged(self):
        image = np.arange(12.0).reshape(3, 4)
        shrunk, k = images.shrink(image, 12)
        assert k == 1
        np.testing.assert_array_equal(shrunk, image)

    def test_blocks_are_averaged(self):
        image = np.arange(24.0).reshape(4, 6)
        shrunk, k = images.shrink(image, 6)
        assert k == 2
        np.testing.assert_array_equal(shrunk, image.reshape(2, 2, 3, 2).mean(axis=(1, 3)))

    def test_incomplete_blocks_keep_their_mean(self):
        shrunk, k = images.shrink(np.ones((5, 7)), 10)
        assert k == 2
        np.testing.assert_array_equal(shrunk, np.ones((3, 4)))
