"""Nikon .xtekct: a faithful folder, the signs by CIL's public reader, angle tables, interrupted and damaged scans.

Keys and values as in a public file of CT Pro V5.4 (xray-imaging/meta-cli, docs/source/demo/nikon); signs as in
NikonDataReader of CIL 22 and later, which its authors checked on scans with a rolled and a tilted axis (CIL #1292).
"""

import numpy as np
import pytest
from typer.testing import CliRunner

import grainmotion
from grainmotion.cli.app import app
from grainmotion.errors import InputError
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import Circular, ReferenceTable, StateTable
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.model.finding import Level
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix
from lab_scanner import BALLS, Lab, ball_images
from scanner_folder import MAX_MISFIT, WRONG, changed, misfit, scan_of, write_images

WHITE = 58500
FILE = """[XTekCT]
Name=Beads [1]
OperatorID=
InputSeparator=_
InputFolderName=
OutputSeparator=_
OutputFolderName=Beads [1]
VoxelsX=64
VoxelSizeX=0.1
OffsetX=0.0
SrcToObject=60.0
SrcToDetector=240.0
MaskRadius=9.56649218
DetectorPixelsX=64
DetectorPixelSizeX=0.4
DetectorOffsetX=0.0
DetectorPixelsY=56
DetectorPixelSizeY=0.4
DetectorOffsetY=0.0
RegionStartX=0
Units=mm
Scaling=1000.0
OutputUnits=/m
Projections=6
InitialAngle=20.0
AngularStep=60.0
WhiteLevel=58500
InterpolationType=1
BeamHardeningLUTFile=
Scale=1.0
InputName=Beads [1]
InputDigits=4
AutomaticCentreOfRotation=0
ObjectOffsetX=0.0
ObjectOffsetY=0.0
ObjectTilt=0.0
ObjectRoll=0.0
Blanking=0
[Xrays]
XraykV=90
XrayuA=32
[DICOM]
DICOMTags=<?xml version="1.0" encoding="utf-16"?><ArrayOfMetaDataSchema xmlns:xsd="http://www.w3.org/2001/XMLSchema"/>
[CTPro]
Version=V5.4.7289.18310 (Date:2019-12-16)
Product=[XT 5.4][Copyright (c) 2004-2019 Nikon Metrology NV]
Filter_ThicknessMM=1.0
Filter_Material=Aluminium
Shuttling=False
AngleFile_Use=False
AngleFile_IgnoreErrors=True
""".replace("\n", "\r\n")
ANGLES = 20.0 + 60.0 * np.arange(6)
NAMES = [f"Beads [1]_{n:04d}.tif" for n in range(1, 7)]


def leaning(right_deg, away_deg):
    """Balls on a stage whose axis leans so that its top lies to the source's right and away from it."""
    matrix = rotation_matrix(np.deg2rad([-away_deg, 0, 0])) @ rotation_matrix(np.deg2rad([0, right_deg, 0]))

    def turned(angle_deg):
        stage = matrix @ rotation_matrix(np.deg2rad([0, 0, angle_deg]))
        return tuple((*(stage @ ball[:3]), *ball[3:]) for ball in np.array(BALLS))

    return turned


def images(angles=ANGLES, lab=None, lean=(0.0, 0.0)):
    """What the scanner writes: the stage turns clockwise, and column 0 is at the right as the source sees it."""
    lab, balls = lab or Lab(), leaning(*lean)
    return np.stack([lab.image(0.0, balls(-angle)) for angle in angles])[:, :, ::-1]


def folder_of(folder, text=FILE, lines=None, names=NAMES, name="beads.xtekct"):
    write_images(folder, names, images() if lines is None else lines, WHITE)
    (folder / name).write_bytes(text.encode("cp1252"))
    return folder / name


def test_the_file_alone_is_enough(tmp_path):
    path = folder_of(tmp_path)
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert (scan.kind, scan.white_level, scan.flats) == ("counts", WHITE, None)
    assert scan.findings == ()
    facts = dict(scan.facts)
    assert facts["Format"] == "Nikon .xtekct"
    assert facts["Voltage"] == "90 kV"
    assert facts["Filter"] == "Aluminium"
    read = grainmotion.read_scan(path, path)
    np.testing.assert_allclose(read.line_integrals, ball_images(read.geometry), atol=MAX_MISFIT)


@pytest.mark.parametrize(
    ("keys", "lab", "lean"),
    [
        ({"ObjectOffsetX": 0.3}, Lab(axis_shift=-0.3), (0, 0)),  # to higher columns, which lie at the left
        ({"ObjectRoll": 8.0}, Lab(), (8.0, 0)),
        ({"ObjectTilt": 12.0}, Lab(), (0, 12.0)),
        ({"DetectorOffsetX": 1.2}, Lab(panel_shift=(-1.2, 0)), (0, 0)),
        ({"DetectorOffsetY": 0.8}, Lab(panel_shift=(0, 0.8)), (0, 0)),
    ],
)
def test_signs_of_axis_and_panel(tmp_path, keys, lab, lean):
    path = folder_of(tmp_path, changed(FILE, **keys), images(lab=lab, lean=lean))
    assert misfit(scan_of(path)) < MAX_MISFIT
    wrong = changed(FILE, **{key: -value for key, value in keys.items()})
    assert misfit(scan_of(folder_of(tmp_path, wrong, images(lab=lab, lean=lean)))) > WRONG


@pytest.mark.parametrize(
    "wrong",
    [
        lambda lines: images(-ANGLES),  # the stage turns the other way
        lambda lines: lines[:, ::-1],  # row 0 at the bottom
        lambda lines: lines[:, :, ::-1],  # column 0 at the left
        lambda lines: lines[:, ::-1, ::-1],
        lambda lines: lines[::-1],
    ],
)
def test_images_of_other_signs_do_not_fit(tmp_path, wrong):
    assert misfit(scan_of(folder_of(tmp_path, lines=wrong(images())))) > WRONG


def test_old_files_tell_the_axis_at_the_detector(tmp_path):
    """CIL: at mid-height (top + bottom)/2, demagnified; the angle from their difference over the panel's height."""
    top, bottom, height = 3.0, 0.6, 56 * 0.4
    text = changed(FILE, ObjectOffsetX="", ObjectRoll=None, ObjectTilt=None)
    text = text.replace("ObjectOffsetX=\r\n", f"CentreOfRotationTop={top}\r\nCentreOfRotationBottom={bottom}\r\n")
    views = scan_of(folder_of(tmp_path, text)).geometry
    z = np.array([-1.0, 1.0]) * height / 2 * 60 / 240  # points of the axis that show in the last and first row
    seen = views.project_points(np.stack([0 * z, 0 * z, z], axis=1))[..., 1] - 63 / 2
    np.testing.assert_allclose(seen * 0.4, np.broadcast_to([bottom, top], (6, 2)), atol=0.02)


def cil_views(offset, roll, tilt):
    """ASTRA vectors that CIL makes of the file: its formulas, for cone beams with the panel's origin "top-right"."""
    roll, tilt = np.deg2rad(roll), -np.deg2rad(tilt)
    tilting = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    rolling = np.array([[np.cos(roll), 0, np.sin(roll)], [0, 1, 0], [-np.sin(roll), 0, np.cos(roll)]])
    axis, place = tilting @ rolling @ [0, 0, 1], np.array([-offset, 60.0, 0])
    across = np.cross(axis, [0, 0, 1])
    angle = np.arcsin(np.linalg.norm(across))
    align = rotation_matrix(across / max(np.linalg.norm(across), 1e-12) * angle)
    blocks = [align @ -place, align @ ([0, 240.0, 0] - place), align @ [-0.4, 0, 0], align @ [0, 0, -0.4]]
    rows = []
    for angle in -60.0 * np.arange(6) - 20.0 + 180:
        turn = rotation_matrix(np.deg2rad([0, 0, -angle]))
        rows.append(np.concatenate([turn @ block for block in blocks]))
    return Geometry(np.array(rows), (56, 64), "cone")


@pytest.mark.parametrize(("offset", "roll", "tilt"), [(0, 0, 0), (0.4, 0, 0), (0.2, 3, 0), (-0.3, -2, 5)])
def test_projects_points_where_cil_does(tmp_path, offset, roll, tilt):
    text = changed(FILE, ObjectOffsetX=offset, ObjectRoll=roll, ObjectTilt=tilt)
    points = np.array(BALLS)[:, :3]
    ours = scan_of(folder_of(tmp_path, text)).geometry.project_points(points)
    half_turn = points * [-1, -1, 1]  # CIL adds 180 degrees, as CT Pro turns its volumes
    np.testing.assert_allclose(cil_views(offset, roll, tilt).project_points(half_turn), ours, atol=1e-6)


INTERLACED = np.array([0.0, 180.0, 90.0, 270.0, 45.0, 405.0])


def table_of(angles, head="Projections\tFrames\tExposure(ms)\r\n6\t1\t708.00\r\nProjection\tAngle(deg)\tTime(s)"):
    rows = [f"{n}\t{angle:08.4f}\t{n * 0.7:08.4f}" for n, angle in enumerate(angles, start=1)]
    return "\r\n".join([head, *rows, "", ""])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("_ctdata.txt", table_of(INTERLACED)),
        ("Beads [1].ang", "Proj\tAngle(deg)\r\n" + "".join(f"{n}:\t{a}\r\n" for n, a in enumerate(INTERLACED, 1))),
        (
            "beads.ang",
            "Proj\tAngle(deg)\r\n" + "".join(f"{n}\t{a:.0f},00\r\n" for n, a in enumerate(INTERLACED + 20, 1)),
        ),
    ],
)
def test_tables_of_interlaced_angles_override_the_steps(tmp_path, name, text):
    """Tables count from the start of the scan, or hold InitialAngle already; a decimal comma is read."""
    path = folder_of(tmp_path, lines=images(20 + INTERLACED))
    (tmp_path / name).write_text(text)
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert [f.level for f in scan.findings if "were taken" in f.fact] == [Level.NOTE]


def test_returning_images_of_a_table_are_used(tmp_path):
    """Images taken after the turn, at angles that only the table tells."""
    angles = np.concatenate([ANGLES, [200.0, 20.0]])
    names = [f"Beads [1]_{n:04d}.tif" for n in range(1, 9)]
    path = folder_of(tmp_path, lines=images(angles), names=names)
    (tmp_path / "_ctdata.txt").write_text(table_of(angles - 20))
    scan = scan_of(path)
    assert len(scan.geometry) == 8
    assert misfit(scan) < MAX_MISFIT


def test_a_table_that_reads_back_the_steps_leaves_them(tmp_path):
    """As CT Pro reconstructs, unless AngleFile_Use is set."""
    noise = np.array([0.03, -0.4, 0.5, 0.2, -0.3, 0.1])
    path = folder_of(tmp_path)
    (tmp_path / "_ctdata.txt").write_text(table_of(ANGLES - 20 + noise))
    np.testing.assert_allclose(angles_of(scan_of(path)), ANGLES)
    path = folder_of(tmp_path, changed(FILE, AngleFile_Use="True"))
    np.testing.assert_allclose(angles_of(scan_of(path)), ANGLES + noise, atol=1e-4)


def angles_of(scan):
    return np.unwrap(scan.geometry.azimuths_deg, period=360)


def test_a_table_that_runs_backwards_is_not_taken(tmp_path):
    path = folder_of(tmp_path)
    (tmp_path / "_ctdata.txt").write_text(table_of(20 - ANGLES))
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert any("run against AngularStep" in f.fact and f.level is Level.WARNING for f in scan.findings)


def test_an_interrupted_scan_is_used_as_far_as_it_went(tmp_path):
    path = folder_of(tmp_path, lines=images()[:4], names=NAMES[:4])
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    (finding,) = (f for f in scan.findings if f.check == "file-series")
    assert "4 of 6 images are there, up to number 4: the scan was interrupted" in finding.fact


def test_gaps_are_named_and_each_image_keeps_its_angle(tmp_path):
    keep = [0, 3, 4]
    path = folder_of(tmp_path, lines=images()[keep], names=[NAMES[k] for k in keep])
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert any("3 of 6 images are there; 2-3, 6 are missing" in f.fact for f in scan.findings)


def test_more_images_than_projections(tmp_path):
    scan = scan_of(folder_of(tmp_path, changed(FILE, Projections=4)))
    assert len(scan.geometry) == 4
    assert misfit(scan) < MAX_MISFIT
    assert any("tells of 4 images, but there are 6" in f.fact for f in scan.findings)


def test_images_in_a_folder_of_the_laboratory(tmp_path):
    (tmp_path / "raw").mkdir()
    path = folder_of(tmp_path, changed(FILE, InputFolderName=r"D:\Users\lab\raw"), names=[f"raw/{n}" for n in NAMES])
    assert misfit(scan_of(path)) < MAX_MISFIT


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_encodings_and_decimal_commas(tmp_path, encoding):
    path = folder_of(tmp_path)
    path.write_bytes(FILE.replace("0.4", "0,4").replace("60.0", "60,0").encode(encoding))
    assert misfit(scan_of(path)) < MAX_MISFIT


def test_overrides_of_the_experiment_file(tmp_path):
    path = folder_of(tmp_path, lines=images(-ANGLES))
    assert misfit(scan_of(path, angles_deg=list(-ANGLES))) < MAX_MISFIT


def test_bare_images_of_a_state_are_seen_as_those_of_the_reference(tmp_path):
    path = folder_of(tmp_path)
    state = [0.0, 45.0, 210.0]
    write_images(tmp_path, [f"step_{k}.tif" for k in range(3)], images(state), WHITE)
    reference = ReferenceTable(radiographs=[str(path)])
    circle = Circular(angles_deg=state, pixel_size=None, first_row=None)
    table = StateTable(name="step", radiographs=["step_*.tif"], geometry=circle)
    assert misfit(find_scan("states.step", table, reference, tmp_path)) < MAX_MISFIT


def test_inspect_tells_the_sense_of_rotation_and_the_angles_of_the_file(tmp_path):
    result = CliRunner().invoke(app, ["inspect", str(folder_of(tmp_path))])
    text = " ".join(result.output.split())
    assert "6 from 20 to 320 degrees in steps of 60" in text
    assert "seen from above it turns clockwise" in text


def test_fixes_undo_a_wrong_sense_of_rotation_and_a_wrong_side(tmp_path):
    path = folder_of(tmp_path, lines=images(-ANGLES)[:, :, ::-1])
    table = ReferenceTable(radiographs=[str(path)], fixes=["columns-flipped", "angles-negated"])
    assert misfit(find_scan("reference", table, table, tmp_path)) < MAX_MISFIT


def test_a_file_of_views_tells_of_the_images_as_they_are_stored(tmp_path):
    path = folder_of(tmp_path)
    write_geometry(tmp_path / "views.csv", scan_of(path).geometry)
    table = ReferenceTable(radiographs=[str(path)], geometry="views.csv")
    assert misfit(find_scan("reference", table, table, tmp_path)) < MAX_MISFIT


def test_images_elsewhere_with_the_file_as_geometry(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    path = folder_of(tmp_path, names=[f"elsewhere/{name}" for name in NAMES])
    reference = ReferenceTable(radiographs=["elsewhere/*.tif"], geometry=path.name)
    scan = find_scan("reference", reference, reference, tmp_path)
    assert misfit(scan) < MAX_MISFIT
    assert ("Voltage", "90 kV") in scan.facts
    circle = Circular(angles_deg=list(ANGLES), pixel_size=None, first_row=None)
    state = StateTable(name="step", radiographs=["elsewhere/*.tif"], geometry=circle)
    assert misfit(find_scan("states.step", state, reference, tmp_path)) < MAX_MISFIT


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"SrcToDetector": None}, r"\[XTekCT\] SrcToDetector .*: it is missing: the file is truncated"),
        ({"SrcToObject": 300}, r"\[XTekCT\] SrcToObject .*: 300 is not below SrcToDetector = 240"),
        ({"SrcToObject": "sixty"}, r"\[XTekCT\] SrcToObject .*: 'sixty' is no number"),
        ({"SrcToObject": "nan"}, r"\[XTekCT\] SrcToObject .*: 'nan' is no number"),
        ({"Projections": 0}, r"\[XTekCT\] Projections .*: 0 is not above 0"),
        ({"Projections": 1e12}, r"\[XTekCT\] Projections .*: 1e\+12 is no number of images"),
        ({"Projections": 4.5}, r"\[XTekCT\] Projections .*: 4.5 is no number of images"),
        ({"DetectorPixelSizeY": 0.8}, r"DetectorPixelSizeY .*: 0.8 mm, but DetectorPixelSizeX is 0.4 mm"),
        ({"Name": "Other"}, r"its radiographs are not beside it"),
    ],
)
def test_damaged_and_contradictory_files(tmp_path, keys, message):
    with pytest.raises(InputError, match=message) as caught:
        scan_of(folder_of(tmp_path, changed(FILE, **keys)))
    assert "beads.xtekct" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"[Reconstruction]\r\nName=Beads\r\n", r"no file of a Nikon scanner: it has no section \[XTekCT\]"),
        (b"II*\x00\x08\x00\x00", "no text: it holds zero bytes"),
        (FILE[:300].encode(), "it is missing: the file is truncated"),
    ],
)
def test_foreign_and_truncated_files(tmp_path, data, message):
    path = folder_of(tmp_path)
    path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        scan_of(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (table_of(INTERLACED[:4]), "it holds 4 angles, and none of image 5"),
        (table_of(INTERLACED)[:-40], "is '5', no number of an image and angle|none of image 6"),
        (table_of([0, 90, np.nan, 1, 2, 3]), "line 6 is"),
        ("Projection\tAngle(deg)\r\n", "it holds no angle"),
    ],
)
def test_damaged_tables_of_angles(tmp_path, text, message):
    path = folder_of(tmp_path)
    (tmp_path / "_ctdata.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        scan_of(path)


def test_a_file_whose_last_number_may_be_cut_is_refused(tmp_path):
    """A copy that stopped within WhiteLevel=58500 leaves a number all the same."""
    text = FILE[: FILE.index("8500", FILE.index("WhiteLevel")) + 2]
    assert text.endswith("WhiteLevel=585")
    with pytest.raises(InputError, match=r"\[XTekCT\] WhiteLevel .*: the file ends in this line, after '585'"):
        scan_of(folder_of(tmp_path, text))
    assert scan_of(folder_of(tmp_path, text + "00\n")).white_level == 58500


@pytest.mark.parametrize("end", ["ObjectTi", "ObjectRoll"])
def test_a_file_cut_within_its_keys_is_doubtful(tmp_path, end):
    text = FILE[: FILE.index(end) + len(end)]
    (finding,) = scan_of(folder_of(tmp_path, text)).findings
    assert finding.level is Level.WARNING
    assert "it is probably truncated" in finding.fact
    assert scan_of(folder_of(tmp_path, FILE.rstrip("\r\n"))).findings == ()  # ends in another section


def test_an_axis_that_was_left_to_the_reconstruction_is_doubtful(tmp_path):
    """As in scans of CT Pro before version 4: no offset, and AutomaticCentreOfRotation is 1."""
    old = {"ObjectOffsetX": None, "ObjectRoll": None, "ObjectTilt": None, "AutomaticCentreOfRotation": 1}
    text = changed(FILE, **old).replace("Blanking=0", "CentreOfRotationTop=0.0\r\nCentreOfRotationBottom=0.0")
    (finding,) = scan_of(folder_of(tmp_path, text)).findings
    assert finding.level is Level.WARNING
    assert "it was left to the reconstruction" in finding.fact
    assert scan_of(folder_of(tmp_path, changed(text, CentreOfRotationTop=0.2))).findings == ()


def test_a_missing_step_is_named_by_its_key(tmp_path):
    with pytest.raises(InputError, match=r"angles_deg: it is missing; beads\.xtekct does not tell it: .*AngularStep"):
        scan_of(folder_of(tmp_path, changed(FILE, AngularStep=None)))


@pytest.mark.parametrize(("offset", "seen"), [(3.0, True), (3.4, False)])
def test_an_axis_beside_the_panel_is_named(tmp_path, offset, seen):
    found = scan_of(folder_of(tmp_path, changed(FILE, ObjectOffsetX=offset))).findings
    assert any("columns beside the panel of 64 columns" in f.fact for f in found) is not seen


def test_a_file_that_ends_before_the_axis_is_doubtful(tmp_path):
    text = FILE[: FILE.index("ObjectOffsetX")]
    assert any("the axis was taken in the middle" in f.fact for f in scan_of(folder_of(tmp_path, text)).findings)


def test_binned_images_do_not_pass_for_those_of_the_scanner(tmp_path):
    scan = scan_of(folder_of(tmp_path, lines=images()[:, ::2, ::2]))
    (finding,) = (f for f in scan.findings if f.level is Level.ERROR)
    assert "it tells of 56 x 64 pixels (rows, columns), but Beads [1]_0001.tif has 28 x 32" in finding.fact
