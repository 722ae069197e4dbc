"""A scan and other files in a few lines, before there is an experiment."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.file_contents import describe_file
from grainmotion.experiment.scan_summary import angle_sentence, summarise_file, summarise_scan
from grainmotion.experiment.scan_tables import Circular, ReferenceTable
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.scanners.identify import read_scanner_file
from grainmotion.io.tiff import write_tiff
from grainmotion.model.geometry import Geometry
from lab_scanner import Lab
from nxtomo_writer import write_nxtomo

GOLDEN = 180 * (np.sqrt(5) - 1)


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        (np.arange(361.0), "361 from 0 to 360 degrees in steps of 1"),
        ([*np.arange(0, 180.5, 0.5), 0, 90, 180], "361 from 0 to 180 degrees in steps of 0.5, then 3 more: 0, 90, 180"),
        (np.arange(100) * 3.6 + np.tile([0, 0.01], 50), "100 from 0 to 356.41 degrees in steps of 3.6, each to 0.01"),
        (np.arange(180.0, 0, -0.5), "from 180 to 0.5 degrees in steps of -0.5"),
        (np.arange(50) * GOLDEN, "golden ratio"),
        (np.arange(50) * GOLDEN % 360, "golden ratio"),
        (np.concatenate([np.arange(0, 180, 10.0), np.arange(5, 180, 10.0)]), "interlaced"),
        ([0, 17, 90.0], "irregular"),
        ([12.5], "1 at 12.5 degrees"),
    ],
)
def test_angles_in_words(angles, words):
    assert words in angle_sentence(np.array(angles, dtype=float))


def test_numbers_of_a_scan(tmp_path):
    lab, angles = Lab(), np.arange(0, 360, 30.0)
    write_nxtomo(tmp_path / "scan.nxs", lab.images(-angles), angles)
    sizes = dict(source_to_axis=lab.source_to_axis, source_to_detector=lab.source_to_panel)
    circle = Circular(beam="cone", pixel_size=lab.pixel, first_row="top", axis_offset=0.3, **sizes)
    summary = summarise_scan("scan", ReferenceTable(radiographs=["scan.nxs"], geometry=circle), tmp_path)
    facts = dict(summary.facts)
    assert facts["Radiographs"].startswith("12 of 56 x 64 pixels")
    assert facts["Source to axis, to panel"] == "60 mm, 240 mm"
    assert "0.1" in facts["Pixel, at the axis"]
    assert facts["Angles"] == "12 from 0 to 330 degrees in steps of 30"
    assert facts["Axis on the panel"].startswith("+3.000 columns")
    assert facts["Row 0"] == "the highest row"
    assert summary.first_views is not None
    assert summary.missing == ()


def test_a_file_that_lacks_numbers_says_which(tmp_path):
    write_nxtomo(tmp_path / "scan.nxs", np.zeros((4, 5, 6)), np.arange(4.0) * 45)
    summary = summarise_file(tmp_path / "scan.nxs", read_scanner_file(tmp_path / "scan.nxs"))
    assert dict(summary.facts)["Angles"] == "4 from 0 to 135 degrees in steps of 45"
    assert any("pixel_size" in line for line in summary.missing)
    assert any("first_row" in line for line in summary.missing)


class TestOtherFiles:
    def test_labels_are_told_from_counts(self, tmp_path):
        rng = np.random.default_rng(1)
        write_tiff(tmp_path / "counts.tif", rng.poisson(20_000, (3, 40, 40)).astype(np.uint16))
        labels = np.repeat(np.repeat(rng.integers(0, 9, (3, 4, 4)), 10, axis=1), 10, axis=2)
        write_tiff(tmp_path / "labels.tif", labels.astype(np.uint16))
        assert dict(describe_file(tmp_path / "counts.tif"))["Looks like"] == "counts"
        assert dict(describe_file(tmp_path / "labels.tif"))["Looks like"] == "labels"

    def test_tables(self, tmp_path):
        views = Geometry.cone([0, 10, 20], (4, 5), 0.4, source_to_axis=50, source_to_detector=200)
        write_geometry(tmp_path / "views.csv", views)
        (tmp_path / "angles.txt").write_text("0\n10\n20\n")
        assert dict(describe_file(tmp_path / "views.csv"))["Views"].startswith("3 positions")
        assert dict(describe_file(tmp_path / "angles.txt"))["Angles"] == "3 from 0 to 20 degrees in steps of 10"

    def test_an_unknown_format_is_refused(self, tmp_path):
        (tmp_path / "scan.doc").write_bytes(b"\xd0\xcf\x11\xe0 a letter")
        with pytest.raises(InputError, match=r"scan\.doc"):
            describe_file(tmp_path / "scan.doc")
