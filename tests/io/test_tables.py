"""Geometry and motions as CSV: every digit comes back; errors name the file and the row."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from grainmotion.errors import InputError
from grainmotion.io.geometry_csv import read_geometry, write_geometry
from grainmotion.io.motions_csv import read_motions, write_motions
from grainmotion.io.results import Reference, read_motions_h5, read_reference, write_motions_h5, write_reference
from grainmotion.model.detector_response import Response
from grainmotion.model.geometry import DetectorAlignment, Geometry
from grainmotion.model.motions import COLUMNS, Motions, StateFit, Status
from grainmotion.model.volume import Volume


@pytest.fixture
def geometry():
    panel = DetectorAlignment(offset=(0.3, -0.2), tilts_deg=(1.0, 2.0, 3.0), axis_offset=0.1, axis_tilt_deg=(0.5, 0.0))
    angles = [0.0, 33.3, 121.7]
    return Geometry.cone(angles, (20, 30), 0.127, source_to_axis=100, source_to_detector=400, panel=panel)


class TestGeometryCsv:
    def test_round_trip(self, tmp_path, geometry):
        write_geometry(tmp_path / "g.csv", geometry)
        assert (tmp_path / "g.csv").read_text().splitlines()[0] == "sx,sy,sz,dx,dy,dz,ux,uy,uz,vx,vy,vz"
        back = read_geometry(tmp_path / "g.csv", (20, 30))
        np.testing.assert_array_equal(back.vectors, geometry.vectors)
        assert (back.shape, back.beam) == ((20, 30), "cone")
        assert read_geometry(tmp_path / "g.csv", (20, 30), "parallel").beam == "parallel"

    def test_any_order_of_columns_and_comments(self, tmp_path, geometry):
        table = pd.DataFrame(geometry.vectors, columns=list("abcdefghijkl"))
        table.columns = ["sx", "sy", "sz", "dx", "dy", "dz", "ux", "uy", "uz", "vx", "vy", "vz"]
        table = table[table.columns[::-1]].assign(angle=[0.0, 33.3, 121.7])
        (tmp_path / "g.csv").write_text("# from the bench\n" + table.to_csv(index=False).replace(",", " , "))
        back = read_geometry(tmp_path / "g.csv", (20, 30))
        np.testing.assert_allclose(back.vectors, geometry.vectors)

    @pytest.mark.parametrize(
        ("change", "fact"),
        [
            (lambda t: t.drop(columns=["uy"]), "no column uy"),
            (lambda t: t.iloc[:0], "no view"),
            (lambda t: t.assign(ux=[1.0, np.nan, 1.0]), r"ux is 'nan' in row 2 \(view 1\)"),
            (lambda t: t.assign(sz=["0", "0", "zero"]), r"sz is 'zero' in row 3 \(view 2\)"),
            (lambda t: t.assign(ux=0.0, uy=0.0, uz=0.0), r"view 0 \(row 1\): u or v has zero length"),
            (lambda t: t.assign(vx=t.ux, vy=t.uy, vz=t.uz), "u and v are parallel"),
        ],
    )
    def test_refused(self, tmp_path, geometry, change, fact):
        write_geometry(tmp_path / "g.csv", geometry)
        change(pd.read_csv(tmp_path / "g.csv")).to_csv(tmp_path / "g.csv", index=False)
        with pytest.raises(InputError, match=r"g\.csv.*" + fact):
            read_geometry(tmp_path / "g.csv", (20, 30))

    @pytest.mark.parametrize("text", ["", "no table", "sx,sy\n1,2,3\n4,5,6,7\n", "\x00\x01\x02"])
    def test_no_table_is_refused(self, tmp_path, text):
        (tmp_path / "g.csv").write_text(text)
        with pytest.raises(InputError, match=r"g\.csv"):
            read_geometry(tmp_path / "g.csv", (20, 30))


@pytest.fixture
def motions():
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(4, 6, 6))
    covariances = roots @ roots.transpose(0, 2, 1) * 1e-4
    translations = rng.normal(size=(4, 3))
    covariances[2], translations[2] = np.nan, np.nan
    statuses = [Status.CONVERGED, Status.POORLY_DETERMINED, Status.LEFT_FIELD, Status.NOT_CONVERGED]
    return Motions(
        labels=np.array([3, 1, 7, 12]),
        centers=rng.normal(size=(4, 3)),
        translations=translations,
        rotations=rng.normal(size=(4, 3)),
        covariances=covariances,
        statuses=np.array([s.value for s in statuses]),
        residuals=rng.uniform(size=4),
        iterations=np.array([4, 5, 0, 30]),
        reasons=("", "seen from one side; add a view", "it left; widen the panel", "µ – ε; look"),
        fit=StateFit(1.01, -0.002, (("rigid", 0.2), ("free", 0.01))),
    )


def assert_same_fit(one, other):
    for name in ("gain", "offset", "costs", "downweighted", "notes"):
        assert getattr(one, name) == getattr(other, name)
    for name in ("corrections", "corrections_sd", "background"):
        assert_same_array(getattr(one, name), getattr(other, name))
    assert (one.response is None) == (other.response is None)
    if one.response is not None:
        assert_same_array(one.response.polynomial, other.response.polynomial)
        assert_same_array(one.response.background, other.response.background)


def assert_same_array(one, other):
    assert (one is None) == (other is None)
    if one is not None:
        np.testing.assert_array_equal(one, other)


class TestMotionsFiles:
    def test_csv_has_just_the_columns_of_the_contract(self, tmp_path, motions):
        write_motions(tmp_path / "m.csv", motions)
        assert (tmp_path / "m.csv").read_text().splitlines()[0] == (
            "label,status,x,y,z,ux,uy,uz,wx,wy,wz,sd_ux,sd_uy,sd_uz,sd_wx,sd_wy,sd_wz,residual,iterations"
        )

    def test_csv_round_trip(self, tmp_path, motions):
        write_motions(tmp_path / "m.csv", motions)
        back = read_motions(tmp_path / "m.csv")
        pd.testing.assert_frame_equal(back.to_table(), motions.to_table(), check_exact=False, rtol=1e-14)
        write_motions(tmp_path / "n.csv", back)
        pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "n.csv"), pd.read_csv(tmp_path / "m.csv"), rtol=1e-14)

    def test_csv_is_in_mm_and_degrees(self, tmp_path, motions):
        write_motions(tmp_path / "m.csv", motions)
        table = pd.read_csv(tmp_path / "m.csv")
        np.testing.assert_allclose(table["wx"], np.rad2deg(motions.rotations[:, 0]))
        np.testing.assert_allclose(table["sd_wz"][0], np.rad2deg(np.sqrt(motions.covariances[0, 5, 5])))
        assert np.isnan(table["ux"][2])

    def test_h5_round_trip(self, tmp_path, motions):
        write_motions_h5(tmp_path / "m.h5", motions)
        back = read_motions_h5(tmp_path / "m.h5")
        for name in (
            "labels",
            "centers",
            "translations",
            "rotations",
            "covariances",
            "residuals",
            "iterations",
        ):
            np.testing.assert_array_equal(getattr(back, name), getattr(motions, name))
        assert back.statuses.tolist() == motions.statuses.tolist()
        assert back.reasons == motions.reasons
        assert_same_fit(back.fit, motions.fit)

    def test_h5_round_trip_of_all_that_was_found_of_a_state(self, tmp_path, motions):
        rng = np.random.default_rng(4)
        fit = StateFit(
            1.02, 0.01, (("free", 0.1),), Response(rng.normal(size=(3, 2)), rng.normal(size=(3, 6))),
            rng.normal(size=(3, 3)), rng.uniform(size=(3, 3)), rng.normal(size=6), 0.03, ("one; two", "µ"),
        )  # fmt: skip
        write_motions_h5(tmp_path / "m.h5", replace(motions, fit=fit))
        assert_same_fit(read_motions_h5(tmp_path / "m.h5").fit, fit)

    @pytest.mark.parametrize(
        ("change", "fact"),
        [
            (lambda t: t.drop(columns=["wz"]), "wz"),
            (lambda t: t.assign(label=[1, 1, 2, 3]), "label 1 is given twice"),
            (lambda t: t.assign(label=[1, 1.5, 2, 3]), r"label is '1\.5' in row 2"),
            (lambda t: t.assign(ux=["0", "0", "far", "0"]), "ux is 'far' in row 3"),
            (lambda t: t.assign(status="fine"), "fine"),
        ],
    )
    def test_refused(self, tmp_path, motions, change, fact):
        assert len(COLUMNS) == 19
        change(motions.to_table()).to_csv(tmp_path / "m.csv", index=False)
        with pytest.raises(InputError, match=r"m\.csv.*" + fact):
            read_motions(tmp_path / "m.csv")


class TestReferenceFile:
    def test_round_trip(self, tmp_path):
        volume = Volume(np.random.default_rng(0).uniform(size=(4, 5, 6)), 0.1, (1.0, 2.0, 3.0))
        labels = np.zeros((4, 5, 6), np.int32)
        labels[1:3, 1:3, 1:3] = 2
        write_reference(tmp_path / "r.h5", Reference(volume, (0.3, 0.1), labels, 0.5, (2,)))
        back = read_reference(tmp_path / "r.h5")
        np.testing.assert_array_equal(back.volume.array, volume.array)
        assert (back.volume.voxel_size, back.volume.center) == (0.1, (1.0, 2.0, 3.0))
        assert (back.residuals, back.threshold, back.border) == ((0.3, 0.1), 0.5, (2,))
        np.testing.assert_array_equal(back.labels, labels)

    def test_volume_alone(self, tmp_path):
        write_reference(tmp_path / "r.h5", Reference(Volume.zeros((2, 2, 2), 1.0)))
        assert read_reference(tmp_path / "r.h5").labels is None
