"""Geometry as CSV: exact round trip; errors name the file and the row."""

import numpy as np
import pandas as pd
import pytest

from grainmotion.errors import InputError
from grainmotion.io.geometry_csv import read_geometry, write_geometry
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry


@pytest.fixture
def geometry():
    panel = DetectorAlignment(
        detector_offset=(0.3, -0.2), detector_tilts_deg=(1.0, 2.0, 3.0), axis_offset=0.1, axis_tilt_deg=(0.5, 0.0)
    )
    angles = [0.0, 33.3, 121.7]
    return Geometry.cone(angles, (20, 30), 0.127, source_to_axis=100, source_to_detector=400, panel=panel)


def test_exact_round_trip(tmp_path, geometry):
    write_geometry(tmp_path / "g.csv", geometry)
    assert (tmp_path / "g.csv").read_text().splitlines()[0] == "sx,sy,sz,dx,dy,dz,ux,uy,uz,vx,vy,vz"
    back = read_geometry(tmp_path / "g.csv", (20, 30))
    np.testing.assert_array_equal(back.vectors, geometry.vectors)
    assert (back.shape, back.beam) == ((20, 30), "cone")
    assert read_geometry(tmp_path / "g.csv", (20, 30), "parallel").beam == "parallel"


def test_columns_in_any_order_and_comments_are_read(tmp_path, geometry):
    table = pd.DataFrame(geometry.vectors, columns=list("abcdefghijkl"))
    table.columns = ["sx", "sy", "sz", "dx", "dy", "dz", "ux", "uy", "uz", "vx", "vy", "vz"]
    table = table[table.columns[::-1]].assign(angle=[0.0, 33.3, 121.7])
    (tmp_path / "g.csv").write_text("# from the scanner\n" + table.to_csv(index=False).replace(",", " , "))
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
def test_bad_values_are_refused(tmp_path, geometry, change, fact):
    write_geometry(tmp_path / "g.csv", geometry)
    change(pd.read_csv(tmp_path / "g.csv")).to_csv(tmp_path / "g.csv", index=False)
    with pytest.raises(InputError, match=r"g\.csv.*" + fact):
        read_geometry(tmp_path / "g.csv", (20, 30))


@pytest.mark.parametrize("text", ["", "no table", "sx,sy\n1,2,3\n4,5,6,7\n", "\x00\x01\x02"])
def test_files_that_are_no_table_are_refused(tmp_path, text):
    (tmp_path / "g.csv").write_text(text)
    with pytest.raises(InputError, match=r"g\.csv"):
        read_geometry(tmp_path / "g.csv", (20, 30))


def test_csv_of_spreadsheets(tmp_path):
    views = Geometry.parallel([0.0, 30.0], (20, 30), 0.127)
    write_geometry(tmp_path / "a.csv", views)
    text = (tmp_path / "a.csv").read_text()
    for changed in (
        "\ufeff" + text.replace("\n", "\r\n"),
        text.replace(",", ";").replace(".", ","),
        text.replace(",", "\t"),
    ):
        (tmp_path / "b.csv").write_bytes(changed.encode())
        np.testing.assert_array_equal(read_geometry(tmp_path / "b.csv", (20, 30), "parallel").vectors, views.vectors)
