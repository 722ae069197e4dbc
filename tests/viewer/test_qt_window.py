"""Real windows of napari: they need its Qt and a display, ``make test-viewer``."""

import numpy as np
import pytest

import grainmotion as gm

pytest.importorskip("PyQt6", reason="make test-viewer installs it")
pytestmark = pytest.mark.qt


@pytest.fixture
def processed():
    """A function that lets Qt draw what is due."""
    from qtpy.QtWidgets import QApplication

    def process() -> None:
        for _ in range(40):
            QApplication.processEvents()

    return process


def picture(viewer, processed) -> np.ndarray:
    """Red, green and blue of what the canvas shows."""
    processed()
    return viewer.screenshot(canvas_only=True, flash=False)[..., :3].astype(int)


def share_of_drawn_pixels(image: np.ndarray) -> float:
    return float((image.max(axis=-1) > 30).mean())


def test_each_state_is_drawn_and_looks_different(folder, processed):
    viewer = gm.viewer.open(folder)
    try:
        assert viewer.title.endswith(str(folder))
        pictures = []
        for step in range(3):
            viewer.dims.set_current_step(0, step)
            pictures.append(picture(viewer, processed))
        assert min(map(share_of_drawn_pixels, pictures)) > 0.01
        for one, other in ((0, 1), (1, 2), (0, 2)):
            assert (np.abs(pictures[one] - pictures[other]).max(axis=-1) > 30).mean() > 0.005
    finally:
        viewer.close()


def test_tracks_grow_from_state_to_state(folder, processed):
    viewer = gm.viewer.open(folder)
    try:
        for layer in viewer.layers:
            layer.visible = layer.name == "tracks"
        viewer.scene.overlays.axes.visible = False
        viewer.canvas.overlays.scale_bar.visible = viewer.canvas.overlays.text.visible = False
        drawn = []
        for step in range(3):
            viewer.dims.set_current_step(0, step)
            drawn.append(share_of_drawn_pixels(picture(viewer, processed)))
        assert drawn[0] < drawn[1] < drawn[2]
    finally:
        viewer.close()


def test_residual_radiographs_have_a_window_of_their_own(folder, processed):
    viewer = gm.viewer.open_residuals(folder)
    try:
        assert [layer.name for layer in viewer.layers] == ["residuals one", "residuals two"]
        assert share_of_drawn_pixels(picture(viewer, processed)) > 0.2
    finally:
        viewer.close()
