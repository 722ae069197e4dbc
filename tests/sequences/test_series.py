"""Cumulative and incremental motions: by points carried from state to state, paths by hand, errors by trial."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.motions import Motions, Status
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.sequences.series import Series
from grainmotion.sequences.table import SERIES_COLUMNS

CENTERS = np.array([[1.0, 0.0, 2.0], [-1.0, 3.0, 0.0]])


def motions(translations, rotations, labels=(5, 8), status=Status.CONVERGED, sd=0.0):
    return replace(
        Motions.identity(np.array(labels), CENTERS),
        translations=np.broadcast_to(np.asarray(translations, float), (2, 3)).copy(),
        rotations=np.broadcast_to(np.asarray(rotations, float), (2, 3)).copy(),
        covariances=np.broadcast_to(sd**2 * np.eye(6), (2, 6, 6)).copy(),
        statuses=np.full(2, status.value, dtype="<U20"),
    )


def lost():
    return motions(np.nan, np.nan, status=Status.NOT_FITTED)


def test_increments_carry_points_from_state_to_state():
    """A point of a grain in the first state, carried by the increment about the grain's centre there, is where the
    motion from the reference puts it in the second."""
    rng = np.random.default_rng(0)
    series = Series.of({name: motions(rng.normal(size=(2, 3)), rng.normal(size=(2, 3))) for name in ("a", "b")})
    point = CENTERS + rng.normal(size=(2, 3))
    carried = {
        name: np.einsum("nij,nj->ni", m.matrices, point - m.centers) + m.translations + m.centers
        for name, m in zip(series.states, series.motions)
    }
    center = CENTERS + series["a"].translations
    turned = np.einsum("nij,nj->ni", rotation_matrix(series.rotation_increments[1]), carried["a"] - center)
    np.testing.assert_allclose(turned + center + series.increments[1], carried["b"], atol=1e-12)
    np.testing.assert_allclose(series.increments[0], series["a"].translations)  # from the reference
    np.testing.assert_allclose(series.rotation_increments[0], series["a"].rotations, atol=1e-12)


def test_paths_add_up_and_bridge_states_that_are_not_known():
    steps = {"a": motions([3, 4, 0], [0, 0, 0.1]), "b": lost(), "c": motions([3, 4, 2], [0, 0, -0.2])}
    series = Series.of(steps)
    np.testing.assert_allclose(series.paths, [[5, 5], [np.nan, np.nan], [7, 7]])
    np.testing.assert_allclose(series.rotation_paths[2], 0.4)
    assert np.isnan(series.increments[1:]).all()  # of the state that is not known, and of the one after it
    assert np.isnan(series.rotation_increments[1:]).all()


def test_a_grain_in_doubt_has_no_increment():
    doubt = motions([9, 9, 9], 0.5)
    doubt.statuses[1] = Status.NOT_CONVERGED.value
    doubt = replace(doubt, ok_translation=np.zeros(0, bool), ok_rotation=np.zeros(0, bool))
    series = Series.of({"a": motions(0, 0), "b": doubt})
    assert np.isfinite(series.increments[1, 0]).all()
    assert np.isnan(series.increments[1, 1]).all()
    assert np.isnan(series.paths[1, 1])


def test_standard_deviations_of_increments_are_those_of_many_trials():
    """Rotations perturbed on the left by independent errors of unequal size about each axis."""
    rng = np.random.default_rng(1)
    first, second = rotation_matrix([0.3, -0.8, 1.1]), rotation_matrix([-1.0, 0.4, 0.6])
    sd_first, sd_second = np.array([1e-3, 5e-3, 2e-3]), np.array([3e-3, 1e-3, 1e-3])
    errors = rotation_matrix(rng.normal(size=(2, 20_000, 3)) * np.stack([sd_first, sd_second])[:, None])
    steps = errors[1] @ second @ np.swapaxes(errors[0] @ first, 1, 2)
    spread = rotation_vector(steps @ (second @ first.T).T).std(axis=0)
    states = {}
    for name, matrix, sd in (("a", first, sd_first), ("b", second, sd_second)):
        variances = np.concatenate([np.full(3, 0.01), sd]) ** 2
        states[name] = replace(motions(0, rotation_vector(matrix)), covariances=np.tile(np.diag(variances), (2, 1, 1)))
    sd = Series.of(states).increment_sd
    np.testing.assert_allclose(sd[1, 0, 3:], spread, rtol=0.03)
    np.testing.assert_allclose(sd[1, 0, :3], 0.01 * np.sqrt(2))
    np.testing.assert_allclose(sd[0, 0, 3:], sd_first)  # the reference has no error


def test_table_has_a_row_for_each_state_and_grain():
    series = Series.of(
        {"a": motions([1, 0, 0], [0, 0, 0.1]), "b": lost(), "c": motions([2, 0, 0], [0, 0, 0.3])}, {"c": 7}
    )
    table = series.to_table()
    assert list(table.columns) == list(SERIES_COLUMNS)
    assert list(table["state"]) == ["a", "a", "b", "b", "c", "c"]
    assert list(table["index"]) == [1, 1, 2, 2, 3, 3]
    assert list(table["label"]) == [5, 8] * 3
    assert set(table["status"][2:4]) == {"not-fitted"}
    assert table["time"].isna().tolist() == [True] * 4 + [False] * 2
    np.testing.assert_allclose(table["dwz"][0], np.rad2deg(0.1))
    np.testing.assert_allclose(table["wz"][4], np.rad2deg(0.3))
    assert table.attrs["units"]["dux"] == "mm"
    assert table.attrs["units"]["sd_dwz"] == "deg"


def test_rows_are_matched_by_label():
    other = motions([[1, 0, 0], [2, 0, 0]], 0, labels=(8, 5))
    other = replace(other, centers=CENTERS[::-1])
    series = Series.of({"a": motions(0, 0), "b": other})
    np.testing.assert_allclose(series.increments[1, :, 0], [2, 1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Series.of({}), "no state"),
        (lambda: Series.of({"a": motions(0, 0), "b": motions(0, 0, labels=(5, 9))}), "other grains"),
        (lambda: Series.of({"a": motions(0, 0), "b": motions(0, 0)}, {"a": 5, "b": 5}), "do not increase"),
        (lambda: Series(("a", "a"), (motions(0, 0),) * 2, np.zeros(2)), "given twice"),
        (lambda: Series.of({"a": motions(0, 0)})["b"], "no state 'b'; the states are a"),
        (lambda: Series(("a",), (motions(0, 0),) * 2, np.zeros(2)), "1 names, 2 motions"),
    ],
)
def test_contradictions_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_no_grains_and_one_state():
    none = Motions.identity(np.zeros(0, int), np.zeros((0, 3)))
    assert len(Series.of({"a": none, "b": none}).to_table()) == 0
    assert len(Series.of({"a": motions(0, 0)}).to_table()) == 2
