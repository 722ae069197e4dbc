"""Colour maps of the page."""

from __future__ import annotations

import re
from importlib import resources

import matplotlib
import numpy as np
import pytest

SOURCE = resources.files("grainmotion.report").joinpath("assets/colours.js").read_text(encoding="utf-8")


def anchors(name: str) -> np.ndarray:
    """Colours of a map in ``colours.js``, 0 to 1."""
    text = re.search(rf"\n    {name}:\n((?:      .*\n)+?)(?=    \w+:|  \}})", SOURCE)
    assert text is not None
    return np.array([[int(c[i : i + 2], 16) / 255 for i in (0, 2, 4)] for c in re.findall(r"\b[0-9a-f]{6}\b", text[1])])


def lightness(colours: np.ndarray) -> np.ndarray:
    """Lightness L* of sRGB colours, 0 to 100."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    y = linear @ np.array([0.2126, 0.7152, 0.0722])
    return np.where(y > 0.008856, 116 * np.cbrt(y) - 16, 903.3 * y)


@pytest.mark.parametrize(("name", "theirs"), [("viridis", "viridis"), ("cividis", "cividis"), ("grey", "gray")])
def test_maps_of_matplotlib_are_within_two_percent(name, theirs):
    own, t = anchors(name), np.linspace(0, 1, 101)
    drawn = np.stack([np.interp(t, np.linspace(0, 1, len(own)), own[:, k]) for k in range(3)], axis=1)
    assert np.abs(drawn - matplotlib.colormaps[theirs](t)[:, :3]).max() < 0.02


@pytest.mark.parametrize("name", ["batlow", "viridis", "cividis", "grey"])
def test_sequential_maps_grow_lighter_evenly(name):
    """So they can be read without colour."""
    steps = np.diff(lightness(anchors(name)))
    assert (steps > 0).all()


def test_diverging_map_is_lightest_in_the_middle():
    light = lightness(anchors("vik"))
    middle = len(light) // 2
    assert abs(int(light.argmax()) - middle) <= 1
    assert abs(light[0] - light[-1]) < 12
