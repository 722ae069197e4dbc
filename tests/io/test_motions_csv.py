"""Motions as CSV: mm and degrees, exact round trip; errors name the file and the row."""

import csv
import dataclasses

import example_motions
import numpy as np
import pandas as pd
import pytest

from grainmotion.errors import InputError
from grainmotion.io.motions_csv import read_motions, write_motions
from grainmotion.model.motion_table import MOTION_COLUMNS
from grainmotion.model.motions import Motions


@pytest.fixture(name="motions")
def motions_() -> Motions:
    return example_motions.motions()


def test_header_is_the_documented_one(tmp_path, motions):
    write_motions(tmp_path / "m.csv", motions)
    assert (tmp_path / "m.csv").read_text().splitlines()[0] == (
        "label,status,x,y,z,ux,uy,uz,wx,wy,wz,sd_ux,sd_uy,sd_uz,sd_wx,sd_wy,sd_wz,residual,iterations,reason,"
        "ok_translation,ok_rotation"
    )


def test_exact_round_trip(tmp_path, motions):
    write_motions(tmp_path / "m.csv", motions)
    back = read_motions(tmp_path / "m.csv")
    pd.testing.assert_frame_equal(back.to_table(), motions.to_table(), check_exact=False, rtol=1e-14)
    write_motions(tmp_path / "n.csv", back)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "n.csv"), pd.read_csv(tmp_path / "m.csv"), rtol=1e-14)


def test_units_are_mm_and_degrees(tmp_path, motions):
    write_motions(tmp_path / "m.csv", motions)
    table = pd.read_csv(tmp_path / "m.csv")
    np.testing.assert_allclose(table["wx"], np.rad2deg(motions.rotations[:, 0]))
    np.testing.assert_allclose(table["sd_wz"][0], np.rad2deg(np.sqrt(motions.covariances[0, 5, 5])))
    assert np.isnan(table["ux"][2])


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (lambda t: t.drop(columns=["wz"]), "wz"),
        (lambda t: t.assign(label=[1, 1, 2, 3]), "label 1 is given twice"),
        (lambda t: t.assign(label=[1, 1.5, 2, 3]), r"label is '1\.5' in row 2"),
        (lambda t: t.assign(ux=["0", "0", "far", "0"]), "ux is 'far' in row 3"),
        (lambda t: t.assign(status="fine"), "fine"),
        (lambda t: t.assign(ok_rotation=["True", "no", "False", "1"]), "ok_rotation is 'no' in row 2"),
    ],
)
def test_bad_tables_are_refused(tmp_path, motions, change, fact):
    assert len(MOTION_COLUMNS) == 19
    change(motions.to_table()).to_csv(tmp_path / "m.csv", index=False)
    with pytest.raises(InputError, match=r"m\.csv.*" + fact):
        read_motions(tmp_path / "m.csv")


REASONS = ('cut, "in two"; take more views', "", "=1+1 is what it looks like", "line one\nline #2")


def test_reasons_survive(tmp_path, motions):
    write_motions(tmp_path / "m.csv", dataclasses.replace(motions, reasons=REASONS))
    assert read_motions(tmp_path / "m.csv").reasons == (
        *REASONS[:2],
        "1+1 is what it looks like",
        "line one line no. 2",
    )
    assert len((tmp_path / "m.csv").read_text().splitlines()) == 5


@pytest.mark.parametrize("first", "=+-@")
def test_no_reason_is_a_formula_in_a_spreadsheet(tmp_path, motions, first):
    write_motions(tmp_path / "m.csv", dataclasses.replace(motions, reasons=(f"{first} {first}cmd",) * 4))
    with (tmp_path / "m.csv").open(newline="") as file:
        assert [row["reason"] for row in csv.DictReader(file)] == ["cmd"] * 4


def test_files_of_older_versions_have_no_reasons(tmp_path, motions):
    motions.to_table().drop(columns="reason").to_csv(tmp_path / "m.csv", index=False)
    assert read_motions(tmp_path / "m.csv").reasons == ("",) * 4


def test_strains_have_columns_of_their_own_where_they_were_measured(tmp_path):
    strained = example_motions.strained()
    write_motions(tmp_path / "m.csv", strained)
    header = (tmp_path / "m.csv").read_text().splitlines()[0]
    assert header.endswith(
        "reason,ok_translation,ok_rotation,exx,eyy,ezz,eyz,exz,exy,sd_exx,sd_eyy,sd_ezz,sd_eyz,sd_exz,sd_exy"
    )
    back = read_motions(tmp_path / "m.csv")
    np.testing.assert_allclose(back.strains, strained.strains, rtol=1e-14)
    np.testing.assert_allclose(back.strain_sd, strained.strain_sd, rtol=1e-14)
    assert read_motions_of_rigid_grains(tmp_path).strains is None


def read_motions_of_rigid_grains(folder):
    write_motions(folder / "rigid.csv", example_motions.motions())
    return read_motions(folder / "rigid.csv")
