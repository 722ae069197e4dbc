"""Motions (`model.motions`): the table's columns and units, round trip, statuses, refused shapes."""

import dataclasses

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.state_fit import StateFit
from grainmotion.rotations import rotation_matrix

N = 5


@pytest.fixture
def measured():
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(N, 6, 6)) * 1e-2
    motions = dataclasses.replace(
        Motions.identity(np.array([4, 8, 15, 16, 23]), rng.normal(size=(N, 3))),
        translations=rng.normal(size=(N, 3)),
        rotations=rng.normal(size=(N, 3)),
        covariances=factors @ factors.transpose(0, 2, 1),
        statuses=np.array([s.value for s in Status][:N]),
        residuals=rng.uniform(size=N),
        iterations=np.arange(N),
        reasons=("", "a", "b", "c", "d"),
    )
    for array in (motions.translations, motions.rotations, motions.covariances):
        array[3] = np.nan  # left-field
    return motions


class TestTable:
    def test_exact_columns_in_order(self, measured):
        assert ",".join(measured.to_table().columns) == (
            "label,status,x,y,z,ux,uy,uz,wx,wy,wz,sd_ux,sd_uy,sd_uz,sd_wx,sd_wy,sd_wz,residual,iterations,reason,"
            "ok_translation,ok_rotation"
        )

    def test_table_is_in_mm_and_degrees(self, measured):
        table = measured.to_table()
        np.testing.assert_array_equal(table[["x", "y", "z"]], measured.centers)
        np.testing.assert_array_equal(table[["ux", "uy", "uz"]], measured.translations)
        np.testing.assert_allclose(table[["wx", "wy", "wz"]], measured.rotations * 180 / np.pi)
        for k, name in enumerate(["ux", "uy", "uz", "wx", "wy", "wz"]):
            unit = 1 if k < 3 else 180 / np.pi
            np.testing.assert_allclose(table[f"sd_{name}"], unit * np.sqrt(measured.covariances[:, k, k]))
        np.testing.assert_array_equal(table["iterations"], np.arange(N))

    def test_motions_of_a_table_are_those_written(self, measured):
        read = Motions.from_table(measured.to_table())
        for name in ("labels", "centers", "translations", "statuses", "residuals", "iterations"):
            np.testing.assert_array_equal(getattr(read, name), getattr(measured, name))
        np.testing.assert_allclose(read.rotations, measured.rotations, rtol=1e-15)
        np.testing.assert_allclose(
            np.diagonal(read.covariances, axis1=1, axis2=2), np.diagonal(measured.covariances, axis1=1, axis2=2)
        )
        table = read.to_table()
        assert (table.dtypes == measured.to_table().dtypes).all()

    def test_other_column_orders_and_additional_columns_are_read(self, measured):
        table = measured.to_table()
        shuffled = table[table.columns[::-1]].assign(remark="x")
        np.testing.assert_array_equal(Motions.from_table(shuffled).translations, measured.translations)

    def test_missing_columns_are_named(self, measured):
        with pytest.raises(InputError, match=r"state\.csv: columns \['uy', 'sd_wz'\] are missing"):
            Motions.from_table(measured.to_table().drop(columns=["uy", "sd_wz"]), "state.csv")

    def test_an_unknown_status_is_refused(self, measured):
        with pytest.raises(InputError, match=r"motions\.status: \['fine'\] unknown"):
            Motions.from_table(measured.to_table().assign(status="fine"))


class TestMotions:
    def test_identity_has_no_motion_and_is_not_fitted(self):
        start = Motions.identity(np.array([1, 2]), np.ones((2, 3)))
        assert len(start) == 2
        assert not start.ok.any()
        np.testing.assert_array_equal(start.matrices, [np.eye(3)] * 2)
        assert np.isnan(start.covariances).all()
        assert set(start.statuses) == {"not-fitted"}

    def test_motions_of_no_grains(self):
        empty = Motions.identity(np.zeros(0, np.int64), np.zeros((0, 3)))
        assert len(Motions.from_table(empty.to_table())) == 0
        assert empty.matrices.shape == (0, 3, 3)

    def test_ok_is_true_for_converged_grains(self, measured):
        np.testing.assert_array_equal(measured.ok, [True, False, False, False, False])

    def test_translation_and_rotation_are_judged_apart(self, measured):
        statuses = np.array(["converged", "poorly-determined", "ambiguous", "cut", "not-converged"])
        yes, no = np.ones(N, dtype=bool), np.zeros(N, dtype=bool)
        apart = dataclasses.replace(measured, statuses=statuses, ok_translation=yes, ok_rotation=no)
        np.testing.assert_array_equal(apart.ok_translation, [True, True, True, True, False])
        np.testing.assert_array_equal(apart.ok_rotation, [True, False, False, False, False])
        np.testing.assert_array_equal(apart.usable, [True, True, True, True, False])
        assert apart.counts == "4 translations, 1 rotations of 5"
        both = dataclasses.replace(apart, ok_rotation=yes)
        np.testing.assert_array_equal(both.ok_rotation, [True, False, False, True, False])  # nothing is poor then

    def test_which_part_of_a_motion_is_good_follows_its_grain(self, measured):
        poor = dataclasses.replace(
            measured,
            statuses=np.full(N, "poorly-determined"),
            ok_translation=np.arange(N) < 2,
            ok_rotation=np.arange(N) > 2,
        )
        other = poor.for_grains(np.array([16, 99, 8]), np.zeros((3, 3)))
        np.testing.assert_array_equal(other.ok_translation, [False, False, True])
        np.testing.assert_array_equal(other.ok_rotation, [True, False, False])
        read = Motions.from_table(other.to_table())
        np.testing.assert_array_equal(read.ok_translation, other.ok_translation)
        np.testing.assert_array_equal(read.ok_rotation, other.ok_rotation)

    def test_tables_of_older_versions_tell_it_by_the_reason(self, measured):
        statuses = np.array(["converged", "poorly-determined", "poorly-determined", "ambiguous", "poorly-determined"])
        reasons = (
            "", "poorly determined: rotation about any axis; the views, or so round a shape, do not determine it",
            "poorly determined: translation along y; the views do not", "it looks alike", "its label holds two grains",
        )  # fmt: skip
        older = dataclasses.replace(measured, statuses=statuses, reasons=reasons).to_table()
        read = Motions.from_table(older.drop(columns=["ok_translation", "ok_rotation"]))
        np.testing.assert_array_equal(read.ok_translation, [True, True, False, True, False])
        np.testing.assert_array_equal(read.ok_rotation, [True, False, True, False, False])

    def test_matrices_are_those_of_the_rotation_vectors(self, measured):
        np.testing.assert_allclose(measured.matrices[1], rotation_matrix(measured.rotations[1]))

    def test_words_of_the_statuses(self):
        assert [s.value for s in Status] == [
            "converged", "not-converged", "poorly-determined", "left-field", "not-fitted", "ambiguous",
            "absent", "cut", "broken", "deformed",
        ]  # fmt: skip

    @pytest.mark.parametrize(
        ("field", "value"),
        [
            ("centers", np.zeros((N, 2))),
            ("translations", np.zeros((N + 1, 3))),
            ("rotations", np.zeros(N)),
            ("covariances", np.zeros((N, 6))),
            ("statuses", np.array(["converged"])),
            ("residuals", np.zeros((N, 1))),
            ("iterations", np.zeros(N - 1)),
            ("reasons", ("",) * (N - 1)),
        ],
    )
    def test_arrays_of_other_shapes_are_refused(self, measured, field, value):
        with pytest.raises(InputError, match=rf"motions\.{field}"):
            dataclasses.replace(measured, **{field: value})


def test_former_names_of_the_views_corrections_give_their_columns():
    columns = np.arange(12.0).reshape(4, 3)
    fit = StateFit(view_corrections=ViewCorrections.of(columns), view_corrections_sd=ViewCorrections.of(2 * columns))
    with pytest.warns(DeprecationWarning, match="view_corrections"):
        np.testing.assert_array_equal(fit.corrections, columns)
    with pytest.warns(DeprecationWarning, match="view_corrections_sd"):
        np.testing.assert_array_equal(fit.corrections_sd, 2 * columns)
    with pytest.warns(DeprecationWarning, match="view_corrections"):
        assert StateFit().corrections is None
