"""GE / Waygate phoenix .pca: a faithful folder, the directions of a public reader, angles, mirrors, damaged files.

Keys and values as in public files of datos|x 2 acquisition (xray-imaging/meta-cli, docs/source/demo/ge); directions as
SamiAnttalainen/CT_Reconstruction reconstructs with CIL: panel origin "bottom-right", angles 0 ... 360.
"""

import numpy as np
import pytest

import grainmotion
from grainmotion.errors import InputError
from grainmotion.model.finding import Level
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix
from lab_scanner import BALLS, Lab, ball_images
from scanner_folder import MAX_MISFIT, WRONG, changed, misfit, scan_of, write_images

WHITE = 13250
FILE = """[General]
Version=2.4.0.1843
Version-pca=2
Comment=
SystemName=Museum GE Phoenix v|tome|x m µCT

[AutoScO]
Active=1
ImgNr=8

[Geometry]
FDD=240.00000000
FOD=60.00000000
Magnification=4.00000000
VoxelSizeX=0.10000000
VoxelSizeY=0.10000000
CalibValue=0.000
cx=31.50000000
cy=27.50000000
DetectorRot=0.00000000
Tilt=0.00000000
Old_CalibValue=0.00000000

[CT]
Type=0
NumberImages=6
StartImg=7
RotationSector=360.00000000
NrImgDone=7
FreeRayFactor=1.00010000

[Trajectory]
Active=0

[CalibValue]
NumberImages=18

[Image]
Top=0
Left=0
DimX=64
DimY=56
Rotation=0
MirrorX=0
MirrorY=0
FreeRay=13250

[CalibImages]
MGainPoints=2
MGainImg=S:\\CT_DATA\\beads\\beads_bright_90kV_110uA_500ms_1Det.tif
OffsetImg=S:\\CT_DATA\\beads\\beads_Dark_500.tif

[DetectorShift]
Enable=1
Amplitude=5

[Detector]
Name=dxr-250
PixelsizeX=0.40000000
PixelsizeY=0.40000000
NrPixelsX=74
NrPixelsY=56
TimingVal=500.102
Avg=3
Binning=0

[Xray]
Name=xs|240 d
Voltage=90
Current=110
Filter=0.1Cu
""".replace("\n", "\r\n")
ANGLES = 60.0 * np.arange(7)
NAMES = [f"beads_{n:04d}.tif" for n in range(1, 8)]


def images(angles=ANGLES[:6], lab=None):
    """What the scanner writes: the stage turns clockwise, and the image is as the source sees it."""
    return (lab or Lab()).images(-np.asarray(angles))


def folder_of(folder, text=FILE, lines=None, names=NAMES[:6]):
    write_images(folder, names, images() if lines is None else lines, WHITE)
    write_images(folder, ["beads_bright_90kV_110uA_500ms_1Det.tif", "beads_Dark_500.tif"], images()[:2], WHITE)
    (folder / "beads.pca").write_bytes(text.encode("cp1252"))
    return folder / "beads.pca"


def pcj(stage):
    """Places of the axes as datos|x writes them; XD is the shift of the detector, undone in the images."""
    head = "[Info]\r\nTrajectoryType=0\r\nNumImages=6\r\n\r\n[Data]\r\n"
    head += ";ImgNr\tXS\t\tYS\t\tZS\t\tRS\t\tXD\t\tWarmup\tVSenCnt\r\n"
    row = "{}\t0.0000000\t237.6680625\t-60.0000000\t{:.7f}\t{:.7f}\t0\t0\t\r\n"
    return head + "".join(row.format(n, angle, 0.4 * (-1) ** n) for n, angle in enumerate(stage, start=1))


def test_the_file_alone_is_enough(tmp_path):
    path = folder_of(tmp_path)
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert (scan.white_level, scan.flats, scan.darks, scan.findings) == (WHITE, None, None, ())
    facts = dict(scan.facts)
    assert facts["Scanner"] == "Museum GE Phoenix v|tome|x m µCT"
    assert facts["Current"] == "110 µA"
    read = grainmotion.read_scan(path, path)
    np.testing.assert_allclose(read.line_integrals, ball_images(read.geometry), atol=MAX_MISFIT)


@pytest.mark.parametrize(
    ("keys", "wrong", "lab"),
    [
        ({"CalibValue": 4.0}, {"CalibValue": -4.0}, Lab(axis_shift=4 * 0.1)),
        ({"cx": 35.5}, {"cx": 27.5}, Lab(panel_shift=(-4 * 0.4, 0))),
        ({"cy": 24.5}, {"cy": 30.5}, Lab(panel_shift=(0, -3 * 0.4))),
    ],
)
def test_signs_of_axis_and_central_ray(tmp_path, keys, wrong, lab):
    assert misfit(scan_of(folder_of(tmp_path, changed(FILE, **keys), images(lab=lab)))) < MAX_MISFIT
    assert misfit(scan_of(folder_of(tmp_path, changed(FILE, **wrong), images(lab=lab)))) > WRONG


@pytest.mark.parametrize(
    "wrong",
    [
        lambda lines: images(-ANGLES[:6]),
        lambda lines: lines[:, ::-1],
        lambda lines: lines[:, :, ::-1],
        lambda lines: lines[:, ::-1, ::-1],
        lambda lines: lines[::-1],
    ],
)
def test_images_of_other_signs_do_not_fit(tmp_path, wrong):
    assert misfit(scan_of(folder_of(tmp_path, lines=wrong(images())))) > WRONG


@pytest.mark.parametrize(
    ("key", "flip"), [("MirrorX", lambda lines: lines[:, :, ::-1]), ("MirrorY", lambda lines: lines[:, ::-1])]
)
def test_mirrored_images(tmp_path, key, flip):
    """The axis is told in pixels of the images as they are saved."""
    lab = Lab(axis_shift=-0.4) if key == "MirrorX" else Lab(axis_shift=0.4)
    path = folder_of(tmp_path, changed(FILE, **{key: 1, "CalibValue": 4.0}), flip(images(lab=lab)))
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert any(f.level is Level.WARNING and key in f.where for f in scan.findings)


def test_projects_points_where_the_public_reader_does(tmp_path):
    """CIL's cone beam: source on -y, row 0 at the bottom, column 0 at the right, the sample turns counter-clockwise."""
    rows = []
    for angle in ANGLES[:6]:
        turn = rotation_matrix(np.deg2rad([0, 0, -angle]))
        blocks = ([0, -60.0, 0], [0, 180.0, 0], [-0.4, 0, 0], [0, 0, 0.4])
        rows.append(np.concatenate([turn @ block for block in blocks]))
    points = np.array(BALLS)[:, :3]
    theirs = Geometry(np.array(rows), (56, 64), "cone").project_points(points * [-1, 1, -1])  # turned about the beam
    np.testing.assert_allclose(scan_of(folder_of(tmp_path)).geometry.project_points(points), theirs, atol=1e-6)


@pytest.mark.parametrize(
    "stage", [[0, 90, 180, 45, 135, 360], [0, 222.5, 85, 307.5, 170, 32.5], [300, 240, 180, 120, 60, 0]]
)
def test_interlaced_golden_and_returning_stages(tmp_path, stage):
    path = folder_of(tmp_path, lines=images(stage))
    (tmp_path / "beads.pcj").write_text(pcj(stage))
    assert misfit(scan_of(path)) < MAX_MISFIT


def test_the_image_that_closes_the_turn_is_used(tmp_path):
    scan = scan_of(folder_of(tmp_path, lines=images(ANGLES), names=NAMES))
    assert len(scan.geometry) == 7
    assert misfit(scan) < MAX_MISFIT


def test_names_without_a_mark_and_a_scan_whose_name_begins_alike(tmp_path):
    path = folder_of(tmp_path, names=[f"beads{n:05d}.tif" for n in range(1, 7)])
    write_images(tmp_path, [f"beads0{n:05d}.tif" for n in range(1, 7)], images(), WHITE)
    assert misfit(scan_of(path)) < MAX_MISFIT


def test_binned_images_have_the_pixels_of_the_voxels(tmp_path):
    scan = scan_of(folder_of(tmp_path, changed(FILE, PixelsizeX=0.2, PixelsizeY=0.2)))
    assert misfit(scan) < MAX_MISFIT
    assert any("a pixel of 0.4 mm follows from it" in f.fact for f in scan.findings)


def test_turned_detectors_are_named_with_both_signs(tmp_path):
    facts = [str(f) for f in scan_of(folder_of(tmp_path, changed(FILE, DetectorRot=0.5, Tilt=1))).findings]
    assert any("detector_tilts_deg = [0, 0.5, 0] and [0, -0.5, 0]" in f for f in facts)
    assert any("axis_tilt_deg = [1, 0] and [-1, 0]" in f for f in facts)


def test_interrupted_scans(tmp_path):
    scan = scan_of(folder_of(tmp_path, lines=images()[:4], names=NAMES[:4]))
    assert misfit(scan) < MAX_MISFIT
    assert any("4 of 6 images are there, up to number 4" in f.fact for f in scan.findings)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"FOD": 300}, r"\[Geometry\] FOD .*: 300 is not below FDD = 240"),
        ({"FDD": None}, r"\[Geometry\] FDD .*: it is missing: the file is truncated"),
        ({"PixelsizeY": 0.2}, "PixelsizeY .*: 0.2 mm, but PixelsizeX is 0.4 mm"),
        ({"Tilt": 30}, "30 degrees: laminography is not supported"),
        ({"Rotation": 90}, "90: turned images are not supported"),
        ({"RotationSector": "x"}, "RotationSector .*: 'x' is no number"),
    ],
)
def test_contradictory_and_truncated_files(tmp_path, keys, message):
    with pytest.raises(InputError, match=message) as caught:
        scan_of(folder_of(tmp_path, changed(FILE, **keys)))
    assert "beads.pca" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("beads.pca", "[PCA]\nn=3\n", r"no file of a phoenix scanner: it lacks the sections \[Geometry\] and \[CT\]"),
        ("beads.pcj", pcj(ANGLES[:3]), "it holds 3 places of the stage, and none of image 4"),
        ("beads.pcj", "[Info]\nTrajectoryType=0\n", "has no columns ImgNr and RS"),
    ],
)
def test_foreign_files(tmp_path, name, text, message):
    path = folder_of(tmp_path)
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        scan_of(path)
