"""RX Solutions' files: signs on an asymmetric object, with and without ``geom.csv``, bad input.

Sources of the conventions: two readers written for CIL (``RXSolutionsDataReader``: columns of ``geom.csv``, Y along the
axis, edges' middles, row 0 at the top; names of radiographs in its first column) and an example of Pyxu (full turn,
source and panel counter-clockwise from above).
"""

import numpy as np
import pytest
import tifffile

from experiment_scan import reference_scan
from grainmotion.errors import InputError
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import Circular, ReferenceTable, StateTable
from grainmotion.io.scanners.identify import read_scanner_file
from grainmotion.model.finding import Level
from lab_scanner import Lab, ball_images

LAB = Lab(shape=(50, 64), panel_shift=(1.3, -0.7), axis_shift=0.5, panel_roll_deg=2.0)
COUNT, OPEN, LEVEL = 8, 60000.0, 120.0
ANGLES = -360.0 / COUNT * np.arange(COUNT)  # of the stage, counter-clockwise from above
WHITE = {"white_level": OPEN}


def table(lab=LAB, angles=ANGLES, *, y=1, third="top", decimal=".", folder="D:\\scans\\Proj\\"):
    """``geom.csv``: source, panel's centre, middle of the upper or lower edge, middle of the right edge; X Y Z."""
    roll = np.deg2rad(lab.panel_roll_deg)
    right = np.array([np.cos(roll), 0, -np.sin(roll)]) * lab.shape[1] / 2 * lab.pixel
    up = np.array([np.sin(roll), 0, np.cos(roll)]) * lab.shape[0] / 2 * lab.pixel
    center = np.array([lab.panel_shift[0], lab.source_to_panel - lab.source_to_axis, lab.panel_shift[1]])
    points = [np.array([0, -lab.source_to_axis, 0]), center, center + (up if third == "top" else -up), center + right]
    lines = ["Geometry;;;;;;;;;;;;;", "Image;sx;...;;;;;;;;;;;".replace("sx", "Source")]
    for k, angle in enumerate(angles):
        a = np.deg2rad(angle)
        turn = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])  # into the sample's frame
        x, forward, height = np.array([turn @ (p - [lab.axis_shift, 0, 0]) for p in points]).T
        # Y up from a zero far below, X and Z such that all is right-handed; y = -1: Y down
        numbers = np.stack([forward, LEVEL + height, x] if y == 1 else [-forward, LEVEL - height, x], axis=1)
        cells = [f"{v:.6f}".replace(".", decimal) for v in numbers.ravel()]
        lines.append(";".join([f"{folder}proj_{k:04}.tif", *cells, ""]))
    return "\r\n".join(lines) + "\r\n"


def xml(lab=LAB, count=COUNT, **attributes):
    told = {"images": count, "sod": lab.source_to_axis, "sdd": lab.source_to_panel, **attributes}
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<unireconstruction>
  <conebeam>
    <profile images="{told["images"]}" file="Proj"/>
    <acquisitioninfo>
      <xray voltage="120" current="80"/>
      <geometry sod="{told["sod"]}" sdd="{told["sdd"]}"/>
    </acquisitioninfo>
    <volume><voxelSize X="0.1" Y="0.1" Z="0.1"/><size X="64" Y="50" Z="64"/></volume>
  </conebeam>
</unireconstruction>
"""


def scan_folder(folder, *, lab=LAB, angles=ANGLES, csv=True, **kind):
    (folder / "Proj").mkdir(parents=True)
    for k, image in enumerate(lab.images(angles)):
        tifffile.imwrite(folder / f"Proj/proj_{k:04}.tif", np.rint(OPEN * np.exp(-image)).astype(np.uint16))
    (folder / "unireconstruction.xml").write_text(xml(lab, len(angles)))
    if csv:
        (folder / "geom.csv").write_text(table(lab, angles, **kind))
    return folder / "unireconstruction.xml"


def error_of(path, **more):
    scan = reference_scan(path, **WHITE, **more)
    return np.abs(ball_images(scan.geometry) - scan.read()[0].line_integrals).max()


@pytest.mark.parametrize("third", ["top", "bottom"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_scan_with_its_table_of_views(tmp_path, third, decimal):
    path = scan_folder(tmp_path / "scan", third=third, decimal=decimal)
    assert error_of(path) < 3e-4
    assert error_of(path.parent / "geom.csv") < 3e-4
    assert [f for f in reference_scan(path, **WHITE).findings if f.level is not Level.NOTE] == []


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8-sig", "utf-16"])
def test_folders_with_accents_in_any_encoding(tmp_path, encoding):
    path = scan_folder(tmp_path / "scan")
    text = table(folder="D:\\données\\Proj\\", decimal=",")
    (path.parent / "geom.csv").write_bytes(text.encode(encoding))
    assert error_of(path) < 3e-4
    assert error_of(path.parent / "geom.csv") < 3e-4


def test_the_axis_may_point_down_in_the_table(tmp_path):
    path = scan_folder(tmp_path / "scan", y=-1)
    assert error_of(path) < 3e-4
    assert (reference_scan(path, **WHITE).geometry.v[:, 2] < 0).all()


def test_every_wrong_sign_is_seen(tmp_path):
    path = scan_folder(tmp_path / "scan")
    right = reference_scan(path, **WHITE)
    images = right.read()[0].line_integrals
    vectors = right.geometry.vectors.reshape(-1, 4, 3)
    reverse = np.diag([-1.0, 1.0, 1.0])
    wrong = {
        "columns": vectors * np.array([1, 1, -1, 1])[:, None],
        "rows": vectors * np.array([1, 1, 1, -1])[:, None],
        "sense": np.einsum("ij,vkj->vki", reverse, vectors) * np.array([1, 1, -1, 1])[:, None],
        "upside down": vectors * np.array([1, 1, -1]),
        "order": vectors[::-1],
    }
    for name, views in wrong.items():
        geometry = type(right.geometry)(views.reshape(-1, 12), right.geometry.shape)
        assert np.abs(ball_images(geometry) - images).max() > 0.1, name


@pytest.mark.parametrize("first", [0.0, 120.0])
def test_a_state_of_bare_images_has_the_circle_of_the_table(tmp_path, first):
    """Only its angles are told, counted as those of the table, whose first view is anywhere on the circle."""
    path = scan_folder(tmp_path / "scan", angles=ANGLES - first)
    (tmp_path / "step").mkdir()
    turns = np.array([0.0, 50.0, 200.0])
    for k, image in enumerate(LAB.images(-turns)):
        tifffile.imwrite(tmp_path / f"step/r_{k}.tif", np.rint(OPEN * np.exp(-image)).astype(np.uint16))
    reference = ReferenceTable(radiographs=[str(path)], **WHITE)
    circle = Circular(pixel_size=None, first_row=None, angles_deg=turns.tolist())
    state = StateTable(name="step", radiographs=["step/*.tif"], geometry=circle)
    scan = find_scan("states.step", state, reference, tmp_path)
    assert np.abs(ball_images(scan.geometry) - scan.read()[0].line_integrals).max() < 3e-4


def spiral_folder(tmp_path):
    """A scan whose source and panel climb by a millimetre from view to view."""
    path = scan_folder(tmp_path / "scan")
    head, *rows = (path.parent / "geom.csv").read_text().split("\n", 2)
    cells = [row.split(";") for row in rows[1].strip().split("\n")]
    for k, row in enumerate(cells):
        for column in (2, 5, 8, 11):
            row[column] = f"{float(row[column]) + k}"
    (path.parent / "geom.csv").write_text("\n".join([head, rows[0], *(";".join(row) for row in cells)]) + "\n")
    return path


def test_a_table_of_no_circle_tells_none(tmp_path):
    file = read_scanner_file(spiral_folder(tmp_path))
    assert file.views is not None
    assert file.circle.known == {}


def test_the_table_as_geometry_of_images_elsewhere(tmp_path):
    path = scan_folder(tmp_path / "scan")
    assert error_of(path, radiographs=["Proj/*.tif"], geometry="geom.csv") < 3e-4


def test_without_the_table_a_full_turn_is_assumed_and_pixels_are_asked_for(tmp_path):
    lab = Lab(shape=(50, 64))
    path = scan_folder(tmp_path / "scan", lab=lab, csv=False)
    with pytest.raises(
        InputError, match=r"reference\.geometry\.pixel_size: it is missing.*voxels of 0.1 mm would be pixels of 0.4 mm"
    ):
        reference_scan(path, **WHITE)
    assert error_of(path, geometry={"pixel_size": lab.pixel}) < 3e-4
    findings = reference_scan(path, **WHITE, geometry={"pixel_size": lab.pixel}).findings
    assert any("8 equal steps of a full turn were assumed" in f.fact and f.level is Level.WARNING for f in findings)
    for wrong in ({"first_row": "bottom"}, {"angles_deg": ANGLES.tolist()}, {"source_to_axis": 50.0}):
        assert error_of(path, geometry={"pixel_size": lab.pixel, **wrong}) > 0.1


def test_the_xml_as_geometry_of_images_elsewhere(tmp_path):
    path = scan_folder(tmp_path / "scan")
    (path.parent / "Proj").rename(path.parent / "moved")
    with pytest.raises(InputError, match="its radiographs are not beside it"):
        reference_scan(path, **WHITE)
    assert error_of(path, radiographs=["moved/*.tif"], geometry="unireconstruction.xml") < 3e-4


@pytest.mark.parametrize(
    ("key", "right", "wrong"),
    [("axis_offset", 0.5, -0.5), ("first_row", "top", "bottom"), ("detector_tilts_deg", (0, 2.0, 0), (0, -2.0, 0)),
     ("source_to_axis", 60.0, 66.0), ("angles_deg", (-ANGLES).tolist(), ANGLES.tolist())],
)  # fmt: skip
def test_numbers_are_laid_over_the_circle_of_the_table(tmp_path, key, right, wrong):
    path = scan_folder(tmp_path / "scan")
    assert error_of(path, geometry={key: right}) < 3e-4
    assert error_of(path, geometry={key: wrong}) > 0.1


def test_numbers_beside_a_spiral_are_refused(tmp_path):
    path = spiral_folder(tmp_path)
    with pytest.raises(
        InputError, match=r"geometry\.pixel_size: it has no effect beside .*whose views are on no circle"
    ):
        reference_scan(path, **WHITE, geometry={"pixel_size": 0.4})


def test_the_assumed_turn_is_no_doubt_where_angles_are_given(tmp_path):
    path = scan_folder(tmp_path / "scan", csv=False)
    circle = {"pixel_size": 0.4}
    assert any(f.check == "angle-table" for f in reference_scan(path, **WHITE, geometry=circle).findings)
    circle["angles_deg"] = (-ANGLES).tolist()
    assert not any(f.check == "angle-table" for f in reference_scan(path, **WHITE, geometry=circle).findings)


def test_counts_without_flats_ask_for_the_white_level(tmp_path):
    with pytest.raises(InputError, match=r"flats: it is missing.*white_level"):
        reference_scan(scan_folder(tmp_path / "scan"))


@pytest.mark.parametrize("csv", [True, False])
def test_a_lost_radiograph(tmp_path, csv):
    lab = Lab(shape=(50, 64))
    path = scan_folder(tmp_path / "scan", lab=lab, csv=csv)
    (path.parent / "Proj/proj_0003.tif").unlink()
    more = {} if csv else {"geometry": {"pixel_size": lab.pixel}}
    scan = reference_scan(path, **WHITE, **more)
    assert len(scan.geometry) == COUNT - 1
    assert error_of(path, **more) < 3e-4
    assert any("7 of 8 radiographs are there" in f.fact for f in scan.findings)


def test_radiographs_in_the_order_of_the_table(tmp_path):
    """An interlaced scan, whose files are named in another order than they were taken."""
    path = scan_folder(tmp_path / "scan")
    order = np.array([0, 4, 2, 6, 1, 5, 3, 7])
    lines = table().split("\r\n")
    (path.parent / "geom.csv").write_text("\r\n".join([*lines[:2], *(lines[2 + k] for k in order)]))
    assert error_of(path) < 3e-4


@pytest.mark.parametrize(
    ("edit", "fact"),
    [
        (lambda text: text.replace("60", "sixty"), "line 3 is .* not the name of a radiograph and 12 numbers"),
        (lambda text: text[: len(text) * 2 // 3], "line 8 is|views"),
        (lambda text: "\r\n".join(text.split("\r\n")[:2]), "it holds no view below its two header rows"),
        (lambda text: "\r\n".join(text.split("\r\n")[:5]), "it tells 8 radiographs, but geom.csv has 3 views"),
        (lambda text: text.replace(";", ","), "line 3 is"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path, edit, fact):
    path = scan_folder(tmp_path / "scan")
    (path.parent / "geom.csv").write_text(edit(table()))
    with pytest.raises(InputError, match=fact) as error:
        reference_scan(path, **WHITE)
    assert "\n" not in str(error.value)


def test_images_of_another_size_are_refused(tmp_path):
    path = scan_folder(tmp_path / "scan")
    for image in (path.parent / "Proj").iterdir():
        tifffile.imwrite(image, tifffile.imread(image)[:25])
    with pytest.raises(InputError, match=r"geom\.csv .*: a panel of 20 x 25.6 mm and images of \(25, 64\) pixels"):
        reference_scan(path, **WHITE)


def test_contradicting_distances_are_named(tmp_path):
    path = scan_folder(tmp_path / "scan")
    path.write_text(xml(sod=55.0))
    findings = reference_scan(path, **WHITE).findings
    assert any("sod is 55 mm, but geom.csv makes 60" in f.fact and f.level is Level.WARNING for f in findings)


@pytest.mark.parametrize(
    ("text", "fact"),
    [
        (xml()[:200], "truncated or damaged XML"),
        ("<RTKThreeDCircularGeometry/>", "not a file of RX Solutions"),
        (xml(sod="far"), "conebeam/acquisitioninfo/geometry@sod is 'far', not a positive number"),
        (xml(sdd=-3), "geometry@sdd is '-3', not a positive number"),
        (xml(images=""), "conebeam/profile@images is '', not a positive number"),
        (xml(images=5), "it describes 5 radiographs, but 8 lie in Proj"),
        ("\0\1", "truncated or damaged XML"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, text, fact):
    path = scan_folder(tmp_path / "scan", csv=False)
    path.write_text(text)
    with pytest.raises(InputError, match=rf"unireconstruction\.xml.*{fact}") as error:
        reference_scan(path, **WHITE, geometry={"pixel_size": 0.4})
    assert "\n" not in str(error.value)


def test_what_inspect_can_show(tmp_path):
    facts = dict(read_scanner_file(scan_folder(tmp_path / "scan")).facts)
    assert facts == {"Voltage": "120 kV", "Current": "80 uA", "Voxel size of the reconstruction": "0.1 mm"}
