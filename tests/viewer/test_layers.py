"""Layers show grains where they are in each state, in mm and z y x, and napari takes them."""

import numpy as np
import pytest
from napari.layers import Layer

import grainmotion as gm
from grainmotion.errors import InputError
from grainmotion.rotations import apply_motion
from grainmotion.workflow.run import RunResult

LOST = 2


def named(folder, **options):
    return {keys["name"]: (data, keys, kind) for data, keys, kind in gm.viewer.layers(folder, **options)}


def test_voxels_lie_where_the_grains_are(folder, states):
    made = named(folder)
    for name in ("reference", "grains"):
        data, keys, _ = made[name]
        for label, center in zip(states["one"].labels, states["one"].centers):
            voxels = np.argwhere(made["grains"][0] == label).mean(axis=0)
            place = np.array(keys["translate"]) + np.array(keys["scale"]) * voxels
            np.testing.assert_allclose(place, center[::-1], atol=0.01)
        assert data.shape == (24, 26, 28)


def test_surfaces_are_moved_by_the_motions_of_each_state(folder, states):
    data, _, _ = named(folder)["surfaces"]
    vertices, faces, values = data
    still = vertices[vertices[:, 0] == 0][:, :0:-1]
    for step, motions in enumerate(states.values(), start=1):
        moved = vertices[vertices[:, 0] == step][:, :0:-1]
        used = [row for row in range(3) if motions.ok_translation[row]]
        lengths = np.linalg.norm(motions.translations, axis=1)
        shown = values[vertices[:, 0] == step]
        for row in used:
            own = np.isclose(shown, lengths[row])
            start = still[np.linalg.norm(still - motions.centers[row], axis=1) < 0.55]
            expected = apply_motion(motions.matrices[row], motions.translations[row], motions.centers[row], start)
            np.testing.assert_allclose(moved[own], expected, atol=1e-5)
    corners = vertices[faces]
    assert (corners[:, 0, 0] == corners[:, 1, 0]).all()  # no triangle between two states
    assert (corners[:, 0, 0] == corners[:, 2, 0]).all()


def test_grains_without_a_result_are_grey_and_have_no_track_and_no_arrow(folder, states):
    made = named(folder)
    (vertices, _), keys, _ = made["surfaces without a value"]
    assert set(vertices[:, 0]) == {2}
    place = states["two"].centers[LOST] + states["two"].translations[LOST]
    np.testing.assert_allclose(vertices[:, :0:-1].mean(axis=0), place, atol=0.03)
    assert len(np.unique(keys["vertex_colors"], axis=0)) == 1
    tracks, track_keys, _ = made["tracks"]
    assert sorted(map(tuple, tracks[:, :2])) == [(1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2), (3, 0), (3, 1)]
    assert len(track_keys["features"]) == len(tracks)
    arrows, arrow_keys, _ = made["displacements"]
    assert sorted(zip(arrows[:, 0, 0], arrow_keys["features"]["label"])) == [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2)]


def test_tracks_and_arrows_lead_to_the_moved_centres(folder, states):
    made = named(folder)
    tracks, arrows = made["tracks"][0], made["displacements"][0]
    for step, motions in enumerate(states.values(), start=1):
        row = tracks[(tracks[:, 0] == 1) & (tracks[:, 1] == step)][0]
        moved = (motions.centers + motions.translations)[0, ::-1]
        np.testing.assert_allclose(row[2:], moved)
        arrow = arrows[arrows[:, 0, 0] == step][0]
        np.testing.assert_allclose(arrow[0, 1:] + arrow[1, 1:], moved)
        assert arrow[1, 0] == 0


def test_labels_tell_the_grain_of_the_state_that_is_asked_for(folder):
    keys = named(folder, state="one")["grains"][1]
    assert list(keys["features"]["index"]) == [1, 2, 3]
    assert set(keys["features"]["status"]) == {"converged"}
    assert "not-converged" in set(named(folder)["grains"][1]["features"]["status"])


def test_standard_deviations_are_of_a_component_as_in_the_report(folder, states):
    features = named(folder, state="one")["grains"][1]["features"]
    sd = np.sqrt(np.einsum("nkk->nk", states["one"].covariances))
    assert np.isfinite(sd).all()
    np.testing.assert_allclose(features["sd_u"], np.sqrt((sd[:, :3] ** 2).mean(axis=1)), rtol=1e-6)
    np.testing.assert_allclose(features["sd_w"], np.rad2deg(np.sqrt((sd[:, 3:] ** 2).mean(axis=1))), rtol=1e-6)


@pytest.mark.parametrize("value", ["u", "status", "uz", "sd_w", "residual"])
def test_napari_takes_every_layer(folder, value):
    for data in gm.viewer.layers(folder, value=value):
        layer = Layer.create(*data)
        assert layer.axis_labels[-3:] == ("z", "y", "x")
        assert [str(unit) for unit in layer.units[-3:]] == ["millimeter"] * 3


def test_a_value_of_both_signs_is_coloured_about_zero(folder):
    low, high = named(folder, value="uz")["surfaces"][1]["contrast_limits"]
    assert low == -high


def test_residuals_are_one_image_a_state(folder):
    made = gm.viewer.residual_layers(folder)
    assert [keys["name"] for _, keys, _ in made] == ["residuals one", "residuals two"]
    assert [Layer.create(*data).visible for data in made] == [False, True]
    low, high = made[0][1]["contrast_limits"]
    assert low == -high
    assert 2.9 < high < 3  # all but the largest pixels


def test_results_may_be_given_in_any_form(folder):
    names = list(named(folder))
    for results in (gm.read_results(folder), str(folder), RunResult(folder, {}, (), ())):
        assert list(named(results)) == names


def test_a_run_without_states_shows_its_grains(reference, tmp_path):
    from grainmotion.io.results import write_reference

    write_reference(tmp_path / "reference.h5", reference)
    made = named(tmp_path)
    assert list(made) == ["reference", "grains", "surfaces without a value"]
    for data in made.values():
        Layer.create(*data)


@pytest.mark.parametrize(
    ("results", "options", "message"),
    [
        (None, {"value": "speed"}, "there is no 'speed' of a grain; use one of status, u"),
        (None, {"state": "three"}, "no state 'three'; the states are one, two"),
        (np.zeros(3), {}, "got ndarray; give gm.read_results"),
    ],
)
def test_what_cannot_be_shown_is_named(folder, results, options, message):
    with pytest.raises(InputError, match=message):
        gm.viewer.layers(folder if results is None else results, **options)
