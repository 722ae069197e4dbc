"""RTK's geometry: the images that RTK itself made in it are reproduced, and every changed number is seen."""

import re
from pathlib import Path

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.scanners.rtk import read_rtk
from grainmotion.io.scanners.view_panel import Panel
from lab_scanner import ball_images
from read_experiment_scan import misfit, reference_of

DATA = Path(__file__).parent / "rtk_data"
PIXEL = {"cone": 0.6, "parallel": 0.2}
SHAPE = (30, 36)
CURVED = "RadiusCylindricalDetector"
SAME, WRONG = 6e-4, 0.05  # half precision at 1.1 is 5e-4
NAMES = ("GantryAngle", "InPlaneAngle", "OutOfPlaneAngle", "SourceToIsocenterDistance", "SourceToDetectorDistance",
         "SourceOffsetX", "SourceOffsetY", "ProjectionOffsetX", "ProjectionOffsetY")  # fmt: skip


def images(name):
    return np.load(DATA / f"{name}.npy").astype(float)


def without_matrices(text):
    return re.sub(r"\s*<Matrix>.*?</Matrix>", "", text, flags=re.DOTALL)


def altered(tmp_path, change):
    """The cone-beam file with its text changed."""
    (tmp_path / "changed.xml").write_text(change((DATA / "cone.xml").read_text()))
    return read_rtk(tmp_path / "changed.xml", Panel(SHAPE, PIXEL["cone"]))


@pytest.mark.parametrize("name", ["cone", "parallel"])
def test_images_that_rtk_made_are_reproduced(name):
    geometry = read_rtk(DATA / f"{name}.xml", Panel(SHAPE, PIXEL[name]))
    assert geometry.beam == name
    np.testing.assert_allclose(ball_images(geometry), images(name), atol=SAME)


@pytest.mark.parametrize("name", NAMES)
def test_the_other_sign_of_a_number_is_seen(tmp_path, name):
    def negated(text):
        pattern = rf"(<{name}>)(-?)([^<]*)(</{name}>)"
        return re.sub(pattern, lambda m: m[1] + ("" if m[2] else "-") + m[3] + m[4], without_matrices(text))

    changed = ball_images(altered(tmp_path, negated))
    assert np.abs(changed - images("cone")).max() > WRONG


@pytest.mark.parametrize("name", NAMES)
def test_numbers_that_contradict_the_matrix_are_refused(tmp_path, name):
    pattern = rf"<{name}>(-?[\d.]*[1-9][\d.]*)</{name}>"
    with pytest.raises(InputError, match=r"the Matrix of projection \d contradicts"):
        altered(tmp_path, lambda text: re.sub(pattern, lambda m: f"<{name}>{float(m[1]) + 1}</{name}>", text))


def test_through_an_experiment_file(tmp_path):
    np.save(tmp_path / "images.npy", images("cone"))
    (tmp_path / "geometry.xml").write_text((DATA / "cone.xml").read_text())
    toml = '[reference]\nradiographs = "images.npy"\nkind = "line-integrals"\n'
    toml += '[reference.geometry]\nfile = "geometry.xml"\n'
    assert misfit(reference_of(tmp_path, toml + "pixel_size = 0.6\n")) < SAME
    assert misfit(reference_of(tmp_path, toml + 'pixel_size = 0.6\nfirst_row = "top"\n')) > WRONG
    with pytest.raises(InputError, match=r"geometry\.xml.*size of a pixel.*pixel_size"):
        reference_of(tmp_path, toml)
    with pytest.raises(InputError, match="source_to_axis: it has no effect beside"):
        reference_of(tmp_path, toml + "pixel_size = 0.6\nsource_to_axis = 60\n")


@pytest.mark.parametrize(("name", "pixels"), [("top", -3), ("bottom", 3)])
def test_rows_from_the_top_and_an_origin_elsewhere(name, pixels):
    offset = (2 * PIXEL["cone"], 3 * PIXEL["cone"])
    geometry = read_rtk(DATA / "cone.xml", Panel(SHAPE, PIXEL["cone"], name, offset=offset))
    seen = images("cone")[:, ::-1] if name == "top" else images("cone")
    np.testing.assert_allclose(ball_images(geometry)[:, 3:-3, :-2], seen[:, 6:, 2:], atol=SAME)
    assert pixels * geometry.v[0, 2] > 0


def test_numbers_beside_the_projections_are_those_of_all(tmp_path):
    def gathered(text):
        text = re.sub(r"\s*<SourceOffsetX>[^<]*</SourceOffsetX>", "", without_matrices(text))
        return text.replace("  <Projection>", "  <SourceOffsetX>1.5</SourceOffsetX>\n  <Projection>", 1)

    geometry = altered(tmp_path, gathered)
    first = read_rtk(DATA / "cone.xml", Panel(SHAPE, PIXEL["cone"]))
    np.testing.assert_allclose(geometry.source[0] - first.source[0], [1.5, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda text: text[:700], "truncated or malformed XML"),
        (lambda text: "", "truncated or malformed|empty"),
        (lambda text: text.replace("RTKThreeDCircularGeometry", "Other"), "its root is Other"),
        (lambda text: text.replace('version="3"', 'version="1"'), "version 1 of the format"),
        (lambda text: text.replace('version="3"', ""), "version None"),
        (lambda text: text.replace("<GantryAngle>35<", "<GantryAngle>x<"), "GantryAngle of projection 1 is 'x'"),
        (lambda text: text.replace("<GantryAngle>35<", "<GantryAngle>nan<"), "GantryAngle of projection 1 is 'nan'"),
        (lambda text: text.replace("<GantryAngle>35<", "<GantryAngle><"), "GantryAngle of projection 1 is ''"),
        (lambda text: re.sub(r"<Matrix>\s*\S+", "<Matrix>", text), "Matrix of projection 0 is no 3 x 4"),
        (lambda text: re.sub(r"<Projection>.*</Projection>", "", text, flags=re.DOTALL), "holds no projection"),
        (lambda text: text.replace("  <Proj", f"<{CURVED}>9</{CURVED}><Proj", 1), "curved panel"),
        (lambda text: without_matrices(text).replace("Distance>241<", "Distance>0<"), "in some projections only"),
    ],
)  # fmt: skip
def test_bad_files(tmp_path, change, match):
    with pytest.raises(InputError, match=match) as error:
        altered(tmp_path, change)
    assert "changed.xml" in str(error.value)
    assert "\n" not in str(error.value)
