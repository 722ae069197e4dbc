"""North Star Imaging's project files: signs on an asymmetric object, corrections of the images, bad input.

Source of the conventions: mbirjax ``preprocess/nsi.py`` (vectors of ``Result``, ``Correction``, ``clockwise``,
``Geometry Report.rtf``, folders); the structure of the text is that of a project of version 2.0.
"""

import numpy as np
import pytest
import tifffile

from experiment_scan import reference_scan
from grainmotion import read_scan
from grainmotion.errors import InputError, InputWarning
from grainmotion.io.scanners.identify import read_scanner_file
from grainmotion.model.finding import Level
from lab_scanner import Lab, ball_images

LAB = Lab(shape=(50, 64), panel_shift=(1.3, -0.7), axis_shift=0.5, panel_roll_deg=2.0)
STEP, COUNT = 72.5, 6  # more than one turn
OPEN, DARK = 30000.0, 400.0
AXES = {  # NSI's x, y, z in the laboratory: y up, either end in front
    "x right": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float),
    "x left": np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]], float),
}


def words(vector):
    return " ".join(f"{x:.9g}" for x in vector)


def project(lab=LAB, *, axes="x right", clockwise=True, height=3.0, axis_sign=1, **given):
    """The text of a project; ``given`` replaces values by their tags, None leaves them out."""
    frame, roll = AXES[axes], np.deg2rad(lab.panel_roll_deg)
    origin = np.array([lab.axis_shift, 0.0, height])  # on the rotation axis, anywhere along it
    right, up = -(lab.shape[1] - 1) / 2 * lab.pixel, (lab.shape[0] - 1) / 2 * lab.pixel
    across = np.cos(roll) * right + np.sin(roll) * up + lab.panel_shift[0]
    above = -np.sin(roll) * right + np.cos(roll) * up + lab.panel_shift[1]
    corner = np.array([across, lab.source_to_panel - lab.source_to_axis, above])
    values = {
        "file": r"Radiographs-Test part\Test part-radio*.tif",
        "number": COUNT,
        "angleStep": STEP,
        "pitch": f"{lab.pixel} {lab.pixel}",
        "width pixels": lab.shape[1],
        "height pixels": lab.shape[0],
        "source": words(frame @ (np.array([0, -lab.source_to_axis, 0]) - origin)),
        "reference": words(frame @ (corner - origin)),
        "axis": words(frame @ np.array([0, 0, axis_sign])),
        "normal": words(frame @ np.array([0, 1, 0])),
        "horizontal": words(frame @ np.array([np.cos(roll), 0, -np.sin(roll)])),
        "clockwise": clockwise,
        "rotate": 0,
        "flipH": False,
        "flipV": False,
        "units": "[mm]",
        **{name.replace("_", " "): value for name, value in given.items()},
    }
    tag = {name: "" if value is None else f"<{name}>{value}" for name, value in values.items()}
    return f"""<NSI Reconstruction Project>
  <version>2.0
  <Project Name>Test part
  <Object Radiograph>
    {tag["file"]}
    {tag["number"]}
    {tag["pitch"]}
    {tag["angleStep"]}
  </Object Radiograph>
  <CT Project Configuration>
    <Technique Configuration>
      <Setup>
        {tag["units"]}
        <fixturing>
        <inline scalar>closed value</inline scalar>
        <phys filter>0.040&quot; Cu
      </Setup>
      <Detector>
        {tag["width pixels"]}
        {tag["height pixels"]}
      </Detector>
      <Source>
        <kV>120
      </Source>
    </Technique Configuration>
    <Rotation range>360
  </CT Project Configuration>
  <Correction>
    {tag["rotate"]}
    {tag["flipH"]}
    {tag["flipV"]}
  </Correction>
  <Processed>
    {tag["clockwise"]}
  </Processed>
  <Geometry>
    <Result>
      {tag["source"]}
      {tag["reference"]}
      {tag["axis"]}
      {tag["normal"]}
      {tag["horizontal"]}
    </Result>
  </Geometry>
</NSI Reconstruction Project>
"""


def stage_angles(clockwise=True):
    return STEP * np.arange(COUNT) * (-1 if clockwise else 1)  # counter-clockwise, as the laboratory counts


def scan_folder(folder, *, lab=LAB, clockwise=True, images=None, stored=lambda image: image, **given):
    """A scan's folder; ``stored`` makes the images of the files from those that a viewer at the source sees."""
    radiographs = folder / "Radiographs-Test part"
    radiographs.mkdir(parents=True)
    (folder / "Corrections").mkdir()
    images = np.stack([lab.image(a) for a in stage_angles(clockwise)]) if images is None else images
    for k, image in enumerate(images):
        counts = np.rint(DARK + OPEN * np.exp(-stored(image))).astype(np.uint16)
        tifffile.imwrite(radiographs / f"Test part-radio{k:05}.tif", counts)
    tifffile.imwrite(radiographs / "zero_pos.tif", counts)
    tifffile.imwrite(folder / "Corrections/gain0.tif", np.full(counts.shape, DARK + OPEN, np.float32))
    tifffile.imwrite(folder / "Corrections/offset.tif", np.full(counts.shape, DARK, np.float32))
    path = folder / "Test part.nsipro"
    path.write_text(project(lab, clockwise=clockwise, **given).replace("\n", "\r\n"))
    return path


def error_of(path, **table):
    scan = reference_scan(path, **table)
    return np.abs(ball_images(scan.geometry) - scan.read()[0].line_integrals).max()


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("axis_sign", [1, -1])
def test_a_scan_by_its_file_alone(tmp_path, axes, clockwise, axis_sign):
    path = scan_folder(tmp_path / "scan", axes=axes, clockwise=clockwise, axis_sign=axis_sign)
    assert error_of(path) < 3e-4
    assert [f for f in reference_scan(path).findings if f.level is not Level.NOTE] == []


def test_the_numbers_are_those_of_the_laboratory(tmp_path):
    circle = read_scanner_file(scan_folder(tmp_path / "scan")).circle
    assert (circle.source_to_axis, circle.source_to_detector, circle.pixel_size) == pytest.approx((60, 240, 0.4))
    assert circle.axis_offset == pytest.approx(0.5)
    np.testing.assert_allclose(circle.detector_tilts_deg, (0, 2, 0), atol=1e-6)
    assert circle.first_row == "top"


@pytest.mark.parametrize(
    "wrong",
    [
        {"clockwise": False},
        {"horizontal": words([-1, 0, 0])},
        {"normal": words([0, 0.05, -1])},
        {"reference": words([12.3, 6.1, 180])},
        {"flipH": True},
        {"flipV": True},
        {"rotate": 180},
    ],
)
def test_every_wrong_sign_is_seen(tmp_path, wrong):
    path = scan_folder(tmp_path / "scan")
    path.write_text(project(**wrong))
    try:
        error = error_of(path)
    except InputError:  # as <reference> is then on the other side of the source
        error = np.inf
    assert error > 0.1


@pytest.mark.parametrize("key", ["axis_offset", "detector_offset", "detector_tilts_deg", "angles_deg", "first_row"])
def test_each_number_can_be_overridden_and_its_other_sign_is_seen(tmp_path, key):
    path = scan_folder(tmp_path / "scan")
    told = getattr(read_scanner_file(path).circle, key)
    same = told if key == "first_row" else np.asarray(told).tolist()
    other = {"top": "bottom"}[told] if key == "first_row" else (-np.asarray(told)).tolist()
    assert error_of(path, geometry={key: same}) < 3e-4
    assert error_of(path, geometry={key: other}) > 0.1


# Correction tells what makes the images of the files right: first the flips, then turns by 90 degrees, clockwise
UNDONE = {
    "flipH": ({"flipH": True}, lambda image: image[:, ::-1]),
    "flipV": ({"flipV": True}, lambda image: image[::-1]),
    "90": ({"rotate": 90}, lambda image: np.rot90(image)),  # turned back, counter-clockwise
    "180": ({"rotate": 180}, lambda image: image[::-1, ::-1]),
    "270": ({"rotate": 270}, lambda image: np.rot90(image, -1)),
    "90 and flipH": ({"rotate": 90, "flipH": True}, lambda image: np.rot90(image)[:, ::-1]),
    "270 and flipV": ({"rotate": 270, "flipV": True}, lambda image: np.rot90(image, -1)[::-1]),
}


@pytest.mark.parametrize("case", UNDONE)
def test_images_that_the_project_flips_and_turns(tmp_path, case):
    given, stored = UNDONE[case]
    if given.get("rotate") in (90, 270):
        given = {**given, "width_pixels": LAB.shape[0], "height_pixels": LAB.shape[1]}
    path = scan_folder(tmp_path / "scan", stored=stored, **given)
    assert error_of(path) < 3e-4


def test_the_geometry_report_places_the_panel_better(tmp_path):
    path = scan_folder(tmp_path / "scan", lab=LAB)
    reference = [float(x) for x in project().split("<reference>")[1].split("\n")[0].split()]
    moved = [reference[0] + 0.8, reference[1] - 0.4, reference[2]]
    path.write_text(project(reference=words(moved)))
    assert error_of(path) > 0.1
    rtf = r"{\rtf1\ansi {\b Image center}\tab (%.4f, %.4f) [mm]  / (3.768, 4.845) [in]\par}"
    (path.parent / "Geometry Report.rtf").write_text(rtf % (reference[0], reference[1]))
    assert error_of(path) < 2e-3
    assert any("2 pixels from where the project does, and was used" in f.fact for f in reference_scan(path).findings)
    (path.parent / "Geometry Report.rtf").write_text(rtf % (reference[0] + 500, reference[1]))
    assert any("was not used" in f.fact and f.level is Level.WARNING for f in read_scanner_file(path).findings)


def test_a_stopped_scan_and_a_lost_radiograph(tmp_path):
    path = scan_folder(tmp_path / "scan")
    radiographs = path.parent / "Radiographs-Test part"
    (radiographs / "Test part-radio00002.tif").unlink()
    (radiographs / "Test part-radio00005.tif").unlink()
    assert error_of(path) < 3e-4  # the fourth and fifth view keep their angles
    with pytest.warns(InputWarning, match="4 of 6 radiographs are there"):
        read_scan(path, str(path))


def test_recorded_angles_are_used(tmp_path):
    path = scan_folder(tmp_path / "scan")
    recorded = STEP * np.arange(COUNT) + np.array([0, 0.4, -0.3, 0.2, 0.1, -0.2])
    lines = [rf"{a:.3f} D:\scans\Radiographs-Test part\Test part-radio{k:05}.tif" for k, a in enumerate(recorded)]
    positions = path.parent / "Radiographs-Test part/positions.txt"
    positions.write_text("# angle file\n" + "\n".join(lines))
    np.testing.assert_allclose(read_scanner_file(path).circle.angles_deg, recorded, atol=1e-3)
    positions.write_text("\n".join(reversed(lines)).replace("72.9", "172.9"))
    file = read_scanner_file(path)
    np.testing.assert_allclose(file.circle.angles_deg, STEP * np.arange(COUNT))
    assert any("positions.txt are missing or no equal steps" in f.fact for f in file.findings)


def test_images_elsewhere_are_named(tmp_path):
    path = scan_folder(tmp_path / "scan")
    (path.parent / "Radiographs-Test part").rename(path.parent / "moved")
    with pytest.raises(InputError, match=r"Test part\.nsipro.*its radiographs are not beside it; copy them there"):
        reference_scan(path)
    scan = reference_scan(path, radiographs=["moved/*radio*.tif"], geometry=path.name, flats=["Corrections/gain0.tif"],
                          darks=["Corrections/offset.tif"])  # fmt: skip
    assert np.abs(ball_images(scan.geometry) - scan.read()[0].line_integrals).max() < 3e-4


@pytest.mark.parametrize(
    ("given", "fact"),
    [
        ({"source": None}, "<source> of the section <Result> is missing"),
        ({"source": "0 0"}, "<source> of the section <Result> is '0 0', not 3 numbers"),
        ({"axis": "0 nan 0"}, "<axis> of the section <Result> is '0 nan 0', not 3 numbers"),
        ({"axis": "0 0 0"}, "axis, normal or horizontal of the section <Result> are zero"),
        ({"horizontal": "0 0 1"}, "axis, normal or horizontal of the section <Result> are zero or parallel"),
        ({"normal": "0 0 1"}, "<normal> of the section <Result> points from the panel to the source"),
        ({"source": "0 0 0"}, "the source lies on the rotation axis"),
        ({"number": "six"}, "<number> of the section <Object Radiograph> is 'six', not 1 number"),
        ({"number": -6}, "<number> of the section <Object Radiograph> is -6, not a positive whole number"),
        ({"number": "9e99"}, r"it describes 9e\+99 radiographs"),
        ({"number": 4}, "it describes 4 radiographs, but 6 lie in Radiographs-Test part"),
        ({"clockwise": None}, "<clockwise> of the section <Processed> is '', not True or False; add <clockwise>"),
        ({"flipV": "2"}, "<flipV> of the section <Correction> is '2', not True or False"),
        ({"rotate": 7.5}, "<rotate> of the section <Correction> is 7.5 degrees, no quarter turns"),
        ({"pitch": "0.4 0.2"}, "pixels of 0.4 x 0.2 .* are not square"),
        ({"width_pixels": 128}, r"its Detector has \(50, 128\) pixels, but the radiographs have \(50, 64\)"),
    ],
)
def test_projects_that_cannot_be_used(tmp_path, given, fact):
    path = scan_folder(tmp_path / "scan")
    path.write_text(project(**given))
    with pytest.raises(InputError, match=rf"Test part\.nsipro.*{fact}") as error:
        reference_scan(path)
    assert "\n" not in str(error.value)


def test_foreign_and_truncated_files(tmp_path):
    path = scan_folder(tmp_path / "scan")
    whole = path.read_text()
    for text in ("operator=alice\n", '<?xml version="1.0"?>\n<NSIProMetadata/>', "\0\0\0"):
        path.write_text(text)
        with pytest.raises(InputError, match=r"Test part\.nsipro"):
            reference_scan(path)
    for share in (0.1, 0.4, 0.7, 0.9):
        path.write_text(whole[: int(len(whole) * share)])
        with pytest.raises(InputError, match=r"Test part\.nsipro") as error:
            reference_scan(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8-sig", "utf-16"])
def test_names_with_accents_in_any_encoding(tmp_path, encoding):
    path = scan_folder(tmp_path / "scan")
    path.write_bytes(path.read_text().replace("<Project Name>Test", "<Project Name>Zéolithe").encode(encoding))
    assert error_of(path) < 3e-4


def test_units_in_inches_are_doubtful(tmp_path):
    path = scan_folder(tmp_path / "scan", units="[in]")
    assert any("its units are 'in'" in f.fact for f in read_scanner_file(path).findings)


def test_images_in_the_only_folder_of_radiographs(tmp_path):
    path = scan_folder(tmp_path / "scan")
    path.write_text(project(file=r"D:\elsewhere\zeolite*.tif"))
    for image in sorted((path.parent / "Radiographs-Test part").glob("Test*")):
        image.rename(image.with_name(image.name.replace("Test part", "zeolite [1]")))
    assert error_of(path) < 3e-4
