"""Files of a run for ParaView, Fiji and napari, opened as users of these programs do."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyvista
import tifffile

from grainmotion.experiment.config import read_experiment
from grainmotion.io.motions_csv import read_motions
from grainmotion.workflow import run as workflow
from tiny_experiment import BALLS, SHIFTS, VOXEL, write_tiny

PAGE = Path(__file__).parents[2] / "docs" / "export.md"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of a run with exports; state two is 90 s after the reference, state one 30 s."""
    path = write_tiny(tmp_path_factory.mktemp("exports") / "tiny")
    text = path.read_text().replace("[track]", '[output]\nexports = ["vtk", "tiff"]\n[track]')
    text = text.replace('name = "one"', 'name = "one"\ntime = 30').replace('name = "two"', 'name = "two"\ntime = 90')
    path.write_text(text)
    return workflow.run(read_experiment(path)).folder


def test_collections_have_all_states_at_their_times(results):
    for name, count in (("grains.pvd", 3), ("surfaces.pvd", None)):
        reader = pyvista.get_reader(results / name)
        assert reader.time_values == [0.0, 30.0, 90.0]
        for time in reader.time_values:
            reader.set_active_time_value(time)
            mesh = reader.read()[0]
            assert mesh.field_data["TimeValue"][0] == time
            assert set(mesh["label"]) == {1, 2, 3}
            assert count is None or mesh.n_points == count


def test_surfaces_are_the_balls_at_their_places_in_each_state(results):
    places = {"reference_surfaces.vtp": np.zeros(3)}
    places |= {f"{name}/surfaces.vtp": np.array(shift) for name, shift in SHIFTS.items()}
    for file, shift in places.items():
        mesh = pyvista.read(results / file)
        for *center, radius in BALLS:
            distances = np.linalg.norm(mesh.points - center - shift, axis=1)
            near = np.abs(distances - radius) < 0.6 * VOXEL
            assert near.sum() > len(mesh.points) / 6
            middle = (mesh.points[near].min(axis=0) + mesh.points[near].max(axis=0)) / 2
            np.testing.assert_allclose(middle, np.array(center) + shift, atol=0.6 * VOXEL)
        assert mesh.volume == pytest.approx(sum(4 / 3 * np.pi * ball[3] ** 3 for ball in BALLS), rel=0.15)
        assert len(mesh.points) > 300


def test_surface_and_labels_are_in_one_place(results):
    """Voxels of a label lie inside of the surface with its number."""
    image, mesh = pyvista.read(results / "reference.vti"), pyvista.read(results / "reference_surfaces.vtp")
    cells = image.cell_centers()
    for label in (1, 2, 3):
        surface = mesh.extract_points(mesh["label"] == label).extract_surface(algorithm="dataset_surface")
        there = cells.points[cells["label"] == label]
        np.testing.assert_allclose(there.min(axis=0), surface.points.min(axis=0), atol=VOXEL)
        np.testing.assert_allclose(there.max(axis=0), surface.points.max(axis=0), atol=VOXEL)


def test_tiffs_say_their_voxel_size_and_frame(results):
    for name in ("reference.tif", "reference_labels.tif", "one/rebuilt.tif", "two/rebuilt_labels.tif"):
        with tifffile.TiffFile(results / name) as file:
            told = file.imagej_metadata
            assert told["spacing"] == VOXEL
            assert told["unit"] == "mm"
            numerator, denominator = file.pages[0].tags["XResolution"].value
            assert numerator / denominator == pytest.approx(1 / VOXEL)
            assert "grainmotion = " in told["Info"]
            assert "z up" in told["Info"]
            assert file.asarray().shape == (28, 36, 36)


def test_rebuilt_labels_are_the_labels_moved(results):
    before = tifffile.imread(results / "reference_labels.tif")
    for name, shift in SHIFTS.items():
        after = tifffile.imread(results / name / "rebuilt_labels.tif")
        for label in (1, 2, 3):
            moved = np.argwhere(after == label).mean(axis=0) - np.argwhere(before == label).mean(axis=0)
            np.testing.assert_allclose(moved[::-1] * VOXEL, shift, atol=0.5 * VOXEL)


def test_recipe_for_napari_makes_points_and_arrows_where_the_labels_are(results):
    recipes = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    arrays, show = (next(r for r in recipes if words in r) for words in ("tifffile.imread", "import napari"))
    recipe = arrays.replace('results, state = "results", "step-01"', f'results, state = "{results}", "two"')
    assert recipe != arrays
    table = pd.read_csv(results / "two" / "motions.csv")
    names: dict[str, object] = {}
    exec(recipe, names)
    points, arrows, labels, moved = (names[n] for n in ("points", "arrows", "labels", "moved"))
    scale, translate = np.array(names["place"]["scale"]), names["place"]["translate"]
    for point, arrow, label in zip(points, arrows, names["motions"]["label"]):
        at = np.round((point - translate) / scale).astype(int)
        assert labels[tuple(at)] == label
        tip = np.round((arrow.sum(axis=0) - translate) / scale).astype(int)
        assert moved[tuple(tip)] == label
    expected = read_motions(results / "two" / "motions.csv")
    np.testing.assert_allclose(arrows[:, 1], expected.translations[expected.ok_translation][:, ::-1], atol=1e-12)
    assert len(points) == table["ok_translation"].sum() > 0
    for name in re.findall(r"\((\w+),", show):
        assert name in names  # what is shown was made


def test_states_without_a_time_are_numbered(tmp_path, results):
    from grainmotion.experiment.scan_tables import StateTable
    from grainmotion.workflow.exports import time_of

    states = [StateTable(name="a", time=5.0), StateTable(name="b")]
    assert [time_of(s, states) for s in states] == [1.0, 2.0]
