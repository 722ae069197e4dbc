"""The table of all states against the motions of each: random statuses, unknown motions and standard deviations."""

import numpy as np
import pandas as pd
import pytest

from grainmotion.io.motions_csv import read_motions, write_motions
from grainmotion.io.series_files import read_series, write_series
from grainmotion.model.motions import Motions, Status
from grainmotion.model.usable_parts import POORLY_DETERMINED_REASON
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.sequences.series import Series

N, STATES = 40, 5
KEYS = ["label", "status", "ok_translation", "ok_rotation", "reason", "residual", "iterations"]
PARTS = ("rotation about z", "translation along x", "translation along x, rotation about z")


def random_motions(rng, labels, centers):
    """Large rotations, every status, and values that are not known."""
    n = len(labels)
    axes = rng.normal(size=(n, 3))
    rotations = axes / np.linalg.norm(axes, axis=1, keepdims=True) * rng.uniform(0, np.pi, (n, 1))
    roots = rng.normal(size=(n, 6, 6)) * 0.01
    statuses = rng.choice([status.value for status in Status], n)
    parts = rng.choice(PARTS, n)
    poor = statuses == Status.POORLY_DETERMINED.value
    reasons = tuple(f"{POORLY_DETERMINED_REASON}{part}; more views" if k else "" for k, part in zip(poor, parts))
    translations, covariances = rng.normal(size=(n, 3)), roots @ np.swapaxes(roots, 1, 2)
    motions = Motions(
        labels, centers, translations, rotations, covariances, statuses, rng.random(n), rng.integers(1, 50, n), reasons,
        ok_translation=rng.random(n) < 0.5, ok_rotation=rng.random(n) < 0.5,
    )  # fmt: skip
    lost = ~motions.usable & (rng.random(n) < 0.5)
    for values in (motions.translations, motions.rotations, motions.covariances):
        values[lost] = np.nan
    return motions


@pytest.mark.parametrize("seed", range(3))
def test_tables_hold_what_the_motions_of_each_state_hold(tmp_path, seed):
    rng = np.random.default_rng(seed)
    labels, centers = rng.permutation(10 * N)[:N] + 1, rng.normal(size=(N, 3)) * 5
    names = [f"s{k}" for k in range(STATES)]
    motions = {name: random_motions(rng, labels, centers) for name in names}
    write_series(tmp_path / "series.h5", Series.of(motions))
    for suffix in ("csv", "parquet"):
        write_series(tmp_path / f"series.{suffix}", Series.of(motions))
    table = pd.read_csv(tmp_path / "series.csv", keep_default_na=False, na_values=[""])
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "series.parquet").fillna({"reason": ""}),
        table.fillna({"reason": ""}),
        check_dtype=False,
    )
    again = read_series(tmp_path / "series.h5").to_table()
    pd.testing.assert_frame_equal(again, Series.of(motions).to_table(), rtol=1e-9)
    for number, name in enumerate(names, start=1):
        write_motions(tmp_path / f"{name}.csv", motions[name])
        own, rows = pd.read_csv(tmp_path / f"{name}.csv"), table[table["state"] == name].reset_index(drop=True)
        assert (rows["index"] == number).all()
        shared = [column for column in own.columns if column in rows.columns]
        assert {*KEYS, "x", "ux", "wz", "sd_ux", "sd_wz"} <= set(shared)
        pd.testing.assert_frame_equal(own[shared], rows[shared], check_dtype=False, rtol=1e-6, atol=1e-12)
    _check_increments(table, tmp_path, names)


def _check_increments(table, folder, names):
    """A point of a grain, carried from state to state by the increments of the table, is where the state puts it."""
    arm = np.array([0.3, -0.2, 0.5])
    before = None
    for name in names:
        now, rows = read_motions(folder / f"{name}.csv"), table[table["state"] == name]
        du, dw = rows[["dux", "duy", "duz"]].to_numpy(), rows[["dwx", "dwy", "dwz"]].to_numpy()
        ok_u, ok_w = now.ok_translation, now.ok_rotation
        if before is not None:
            ok_u, ok_w = ok_u & before.ok_translation, ok_w & before.ok_rotation
        np.testing.assert_array_equal(np.isfinite(du).all(axis=1), ok_u)
        np.testing.assert_array_equal(np.isfinite(dw).all(axis=1), ok_w)
        np.testing.assert_array_equal(rows[["sd_dux", "sd_duy", "sd_duz"]].notna().all(axis=1), ok_u)
        both = ok_u & ok_w
        zero = np.zeros((len(now), 3))
        u0, w0 = (zero, zero) if before is None else (before.translations, before.rotations)
        centre, turned = now.centers + u0, rotation_matrix(w0[both]) @ arm
        carried = centre[both] + du[both] + np.einsum("nij,nj->ni", rotation_matrix(np.deg2rad(dw[both])), turned)
        there = now.centers[both] + now.translations[both] + rotation_matrix(now.rotations[both]) @ arm
        np.testing.assert_allclose(carried, there, atol=1e-5)
        whole = rotation_vector(rotation_matrix(np.deg2rad(dw[both])))
        assert (np.linalg.norm(whole, axis=1) <= np.pi + 1e-9).all()
        before = now
