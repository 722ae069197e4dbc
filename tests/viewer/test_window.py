"""The viewer is not mirrored, names the state on its slider, and says how napari is installed."""

import sys

import numpy as np
import pytest
from napari.components import ViewerModel
from typer.testing import CliRunner

import grainmotion as gm
from grainmotion.cli import app
from grainmotion.errors import InputError
from grainmotion.viewer.window import fill
from tiny_experiment import TOML


@pytest.fixture
def viewer(folder):
    viewer = ViewerModel()
    fill(viewer, gm.viewer.layers(folder), ("reference", "one", "two"))
    return viewer


def test_states_are_on_a_slider_that_names_them(viewer):
    assert viewer.dims.axis_labels == ("state", "z", "y", "x")
    assert viewer.dims.nsteps[0] == 3
    text = viewer.canvas.overlays.text
    assert text.text == "two"
    viewer.dims.set_current_step(0, 0)
    assert text.text == "reference"
    shown = {layer.name: layer._view_vertices for layer in viewer.layers if "surfaces" in layer.name}
    assert len(shown["surfaces"]) > 0
    assert len(shown["surfaces without a value"]) == 0


def test_the_sample_stands_upright_and_is_not_mirrored(viewer):
    camera, order = viewer.scene.camera, viewer.dims.order[-3:]
    to_eye = {"towards": 1, "away": -1, "up": 1, "down": -1, "right": 1, "left": -1}
    depth, vertical, horizontal = (to_eye[str(way)] for way in camera.orientation)
    axes = np.zeros((3, 3))  # columns: where x, y, z of the sample point on the screen (right, up, to the eye)
    for axis, (row, sign) in zip(order, ((2, depth), (1, vertical), (0, horizontal))):
        axes[row, 3 - axis] = sign  # axis 1 is z, 2 is y, 3 is x
    assert np.linalg.det(axes) == pytest.approx(1)  # right-handed, as x y z
    up = dict(zip(order, camera.up_direction))
    assert up[1] > 0.9  # z
    assert camera.angles != (0, 0, 0)


def test_a_missing_napari_is_told_with_its_remedy(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "napari", None)
    with pytest.raises(InputError, match=r"pip install 'grainmotion\[viewer\]'"):
        gm.viewer.open(folder)
    result = CliRunner().invoke(app.app, ["view", str(folder)])
    assert result.exit_code == 2
    assert "grainmotion[viewer]" in result.output


def test_the_command_finds_the_results_by_file_or_folder(folder, monkeypatch):
    import napari

    shown = []
    monkeypatch.setattr(gm.viewer, "open", lambda results, value: shown.append((results.folder, value)), raising=False)
    monkeypatch.setattr(gm.viewer, "open_residuals", lambda results: shown.append("residuals"), raising=False)
    monkeypatch.setattr(napari, "run", lambda: shown.append("run"), raising=False)
    (folder.parent / "experiment.toml").write_text(TOML)
    for place in (folder, folder.parent, folder.parent / "experiment.toml"):
        result = CliRunner().invoke(app.app, ["view", str(place), "--value", "status"])
        assert result.exit_code == 0, result.output
        assert shown == [(folder, "status"), "residuals", "run"]
        shown.clear()


def test_nothing_is_loaded_without_a_window(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "napari", None)
    assert gm.viewer.layers(folder)


def test_a_folder_without_residuals_is_told(folder, monkeypatch):
    from grainmotion.viewer import window

    monkeypatch.setattr(window, "residual_layers", lambda results: [])
    monkeypatch.setattr(window, "_napari", lambda: None)
    with pytest.raises(InputError, match="no residual radiographs"):
        gm.viewer.open_residuals(folder)
