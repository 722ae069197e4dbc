"""Bruker SkyScan .log: a faithful folder, the signs by TIGRE's public reader, shifts, parts, damaged and foreign logs.

Keys and values as in public logs of SkyScan 1173 and 1272 (xray-imaging/meta-cli, docs/source/demo); signs as in
BrukerDataLoader of TIGRE: rows counted from the bottom, +u to the source's right, its angles turn the source
counter-clockwise, and it takes the images upside down, which is the scanner seen with the source's head down.
"""

import numpy as np
import pytest

import grainmotion
from grainmotion.errors import InputError
from grainmotion.experiment.first_draft import draft_experiment
from grainmotion.experiment.folder_contents import folder_contents
from grainmotion.model.finding import Level
from grainmotion.model.geometry import Geometry
from lab_scanner import BALLS, Lab, ball_images
from scanner_folder import MAX_MISFIT, WRONG, changed, misfit, scan_of, write_images

WHITE = 57000
LAB = Lab()
FILE = """[System]
Scanner=SkyScan1272
Instrument S/N=19N09230
Software Version=1.4
Home Directory=C:\\SkyScan1272
Source Type=HAMAMATSU_L10101-67
Camera Type=XIMEA xiRAY11
Camera Pixel Size (um)=9.0
Camera X/Y Ratio=0.9851
[User]
User Name=Núria
Computer Name=SCAN1272-230
[Acquisition]
Data Directory=D:\\Results\\Núria\\beads
Filename Prefix=beads~00
Filename Index Length=8
Number Of Files=    6
Number Of Rows=   56
Number Of Columns=   64
Partial Width=OFF
Image crop origin X=0
Image crop origin Y=0
Camera binning=2x2
Image Rotation=0.05700
Optical Axis (line)=   28
Camera to Source (mm)=240.00000
Object to Source (mm)=60.00000
Source Voltage (kV)=  60
Source Current (uA)= 166
Image Pixel Size (um)=100.000000
Scaled Image Pixel Size (um)=100.000000
Image Format=TIFF
Depth (bits)=16
Reference Intensity=57000
Exposure (ms)=1175
Rotation Step (deg)=60.000
Use 360 Rotation=YES
Scanning position=28.344 mm
Frame Averaging=ON (3)
Random Movement=ON (20)
Flat Field Correction=ON
FF updating interval=68
Geometrical Correction=ON
Filter=Al 0.25mm
Gantry direction=CC
Rotation Direction=CC
Type of Detector Motion=STEP AND SHOOT
Scanning Trajectory=ROUND
Number Of Horizontal Offset Positions=1
Number of connected scans=1
Study Date and Time=14 Mar 2023  09h:00m:40s
Scan duration=0h:54m:2s
[Reconstruction]
Pseudo-parallel projection calculated=1
""".replace("\n", "\r\n")
STAGE = 60.0 * np.arange(6)  # counter-clockwise
NAMES = [f"beads~00{n:08d}.tif" for n in range(6)]


def images(stage=STAGE, lab=LAB):
    """What the scanner writes: the stage turns counter-clockwise, column 0 is at the right as the source sees it."""
    return lab.images(stage)[:, :, ::-1]


def folder_of(folder, text=FILE, lines=None, names=NAMES):
    write_images(folder, names, images() if lines is None else lines, WHITE)
    write_images(folder, ["beads~00_spr.tif", "beads~00_rec00000021.tif"], images()[:2], WHITE)
    (folder / "beads.log").write_bytes(text.encode("cp1252"))
    return folder / "beads.log"


def test_the_log_alone_is_enough(tmp_path):
    path = folder_of(tmp_path)
    scan = scan_of(path)
    assert misfit(scan) < MAX_MISFIT
    assert scan.circle.pixel_size == pytest.approx(0.4)  # 0.1 mm at the axis, binning included
    assert [f.level for f in scan.findings] == [Level.NOTE]  # of the count of the open beam
    facts = dict(scan.facts)
    assert facts["Scanner"] == "SkyScan1272"
    assert facts["Date"] == "14 Mar 2023  09h:00m:40s"
    read = grainmotion.read_scan(path, path)
    np.testing.assert_allclose(read.line_integrals, ball_images(read.geometry), atol=MAX_MISFIT)


@pytest.mark.parametrize("line", [22, 33])
def test_the_optical_axis_counts_rows_from_the_bottom(tmp_path, line):
    text = changed(FILE, **{"Optical Axis (line)": line})
    lab = Lab(panel_shift=(0, (56 / 2 - line) * 0.4))  # the central ray low on the panel: the panel is up
    assert misfit(scan_of(folder_of(tmp_path, text, images(lab=lab)))) < MAX_MISFIT
    from_top = changed(FILE, **{"Optical Axis (line)": 56 - line})
    assert misfit(scan_of(folder_of(tmp_path, from_top, images(lab=lab)))) > WRONG


@pytest.mark.parametrize(
    "wrong",
    [
        lambda lines: images(-STAGE),
        lambda lines: lines[:, ::-1],
        lambda lines: lines[:, :, ::-1],
        lambda lines: lines[:, ::-1, ::-1],
        lambda lines: lines[::-1],
    ],
)
def test_images_of_other_signs_do_not_fit(tmp_path, wrong):
    assert misfit(scan_of(folder_of(tmp_path, lines=wrong(images())))) > WRONG


def test_clockwise_scans_start_angles_and_older_logs(tmp_path):
    text = changed(FILE, **{"Rotation Direction": "CW", "Optical Axis (line)": None, "Reference Intensity": None})
    text = text.replace("Filter=Al", "Scanning Start Angle=25.0\r\nFilter=Al").replace("Number Of", "Number of")
    scan = scan_of(folder_of(tmp_path, text, images(-25 - STAGE)), detector_offset=(0.0, 0.0))
    assert scan.white_level == 65535
    np.testing.assert_allclose(ball_images(scan.geometry), images(-25 - STAGE), atol=1e-9)


def tigre_views(line, shifts):
    """ASTRA vectors of TIGRE's geometry: source on +x, u along +y, v along +z, angles counter-clockwise."""
    rows = []
    for angle, (x, y) in zip(STAGE, shifts, strict=True):
        c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
        beam, u, v = np.array([c, s, 0]), np.array([-s, c, 0]), np.array([0, 0, 1.0])
        center = -180 * beam + x * 0.2 * u + ((line - 28) * 0.4 + y * 0.2) * v  # offDetector, binned 2x2
        rows.append(np.concatenate([60 * beam, center, 0.4 * u, 0.4 * v]))
    return Geometry(np.array(rows), (56, 64), "cone")


SHIFTS = np.random.default_rng(3).integers(-8, 9, (6, 2)).astype(float)
CSV = "Dataset;beads\r\nDate\r\n\r\nlines\r\nNumber,X,Y\r\n" + "".join(
    f"{n},{x},{y}\r\n" for n, (x, y) in enumerate(SHIFTS)
)


@pytest.mark.parametrize("shifted", [False, True])
def test_projects_points_where_tigre_does(tmp_path, shifted):
    path = folder_of(tmp_path, changed(FILE, **{"Optical Axis (line)": 24}))
    if shifted:
        (tmp_path / "beads~00_TS.csv").write_text(CSV)
    points = np.array(BALLS)[:, :3]
    head_down = points @ np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1.0]])  # TIGRE's frame, half a turn about the beam
    scan = scan_of(path)
    theirs = tigre_views(24, SHIFTS if shifted else 0 * SHIFTS).project_points(head_down)
    np.testing.assert_allclose(scan.geometry.project_points(points), theirs, atol=1e-6)
    assert any("their signs are not documented" in f.remedy for f in scan.findings) == shifted


def test_shifts_that_were_applied_to_the_images_are_not_used(tmp_path):
    text = FILE.replace("Scan duration", "TS modified at=July20,12:15:07 ---  6 of 6 projections\r\nScan duration")
    path = folder_of(tmp_path, text)
    (tmp_path / "beads~00_TS.csv").write_text(CSV)
    assert misfit(scan_of(path)) < MAX_MISFIT


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CSV[: CSV.index("\n4,")], "it holds shifts of 4 images, and none of image 4"),
        (CSV[:-6], "is '5,|none of image 5"),
        ("no,table\r\n", "it holds no shift of an image"),
    ],
)
def test_damaged_tables_of_shifts(tmp_path, text, message):
    path = folder_of(tmp_path)
    (tmp_path / "beads~00_TS.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        scan_of(path)


def test_a_file_that_is_counted_but_not_written_is_not_missed(tmp_path):
    scan = scan_of(folder_of(tmp_path, lines=images()[:5], names=NAMES[:5]))
    assert misfit(scan) < MAX_MISFIT
    assert not any(f.check == "file-series" for f in scan.findings)


def test_interrupted_scans_and_gaps(tmp_path):
    keep = [0, 2, 3]
    scan = scan_of(folder_of(tmp_path, lines=images()[keep], names=[NAMES[k] for k in keep]))
    assert misfit(scan) < MAX_MISFIT
    assert any("3 of 6 images are there; 1, 4 are missing" in f.fact for f in scan.findings)


def test_parallel_beams_have_a_source_a_kilometre_away(tmp_path):
    """As NRecon's manual has it for beamlines."""
    lab = Lab(parallel=True, pixel=0.1)
    text = changed(FILE, **{"Object to Source (mm)": 10000001, "Camera to Source (mm)": None})
    scan = scan_of(folder_of(tmp_path, text, images(lab=lab)))
    assert scan.geometry.beam == "parallel"
    assert misfit(scan) < MAX_MISFIT


def test_doubtful_numbers_are_named(tmp_path):
    text = changed(FILE, **{"Image Rotation": -3.0, "Number of connected scans": 2, "Rotation Direction": None})
    facts = [str(f) for f in scan_of(folder_of(tmp_path, text)).findings if f.level is Level.WARNING]
    assert any("-3 degrees are not used" in f and "[0, -3, 0] and [0, 3, 0]" in f for f in facts)
    assert any("Rotation Direction: it is missing; CC was taken" in f for f in facts)
    assert any("2 scans above one another; only that of beads~00 is read" in f for f in facts)


def test_init_takes_previews_and_slices_for_no_states(tmp_path):
    stage = 10.0 * np.arange(36)
    text = changed(FILE, **{"Number Of Files": 36, "Rotation Step (deg)": 10})
    for name, log, angles in (("initial", text, stage), ("step", FILE, STAGE)):
        (tmp_path / name).mkdir()
        folder_of(tmp_path / name, log, images(angles), [f"beads~00{n:08d}.tif" for n in range(len(angles))])
    draft = draft_experiment(folder_contents(tmp_path))
    assert [line for line in draft.text.split("\n") if line.startswith("radiographs")] == [
        'radiographs = "initial/beads.log"    # 36 radiographs',
        'radiographs = "step/beads.log"    # 6 radiographs',
    ]
    assert draft.todo == ()


@pytest.mark.parametrize(("origin", "warned"), [(16, False), (2, True)])
def test_cropped_images(tmp_path, origin, warned):
    """64 columns are 66 % of 97: the crop is in the middle if it begins at column 16."""
    text = changed(FILE, **{"Partial Width": " 66%", "Image crop origin X": origin})
    found = scan_of(folder_of(tmp_path, text)).findings
    assert any("cropped 14 columns beside the middle" in f.fact for f in found) is warned


def test_scans_without_flat_field_correction_need_flats(tmp_path):
    with pytest.raises(InputError, match=r"reference.flats: it is missing"):
        scan_of(folder_of(tmp_path, changed(FILE, **{"Flat Field Correction": "OFF"})))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"Scanning Trajectory": "SPIRAL"}, "SPIRAL: a trajectory that is no circle is not supported"),
        ({"Number Of Horizontal Offset Positions": 2}, "2: a scan stitched from several places of the camera"),
        ({"Object to Source (mm)": 250}, r"Object to Source \(mm\) .*: 250 is not below Camera to Source \(mm\) = 240"),
        (
            {"Image Pixel Size (um)": None, "Scaled Image Pixel Size (um)": None},
            r"Image Pixel Size \(um\) .*: it is missing: the file is truncated",
        ),
        ({"Rotation Direction": "up"}, "'UP' is unknown; CC and CW are known"),
        ({"Reference Intensity": -5}, r"Reference Intensity .*: -5 is no count"),
        ({"Reference Intensity": None, "Depth (bits)": 160}, r"Depth \(bits\) .*: 160 is no number of bits"),
    ],
)
def test_contradictory_and_truncated_logs(tmp_path, keys, message):
    with pytest.raises(InputError, match=message) as caught:
        scan_of(folder_of(tmp_path, changed(FILE, **keys)))
    assert "beads.log" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_images_of_another_name_are_not_taken(tmp_path):
    path = folder_of(tmp_path, changed(FILE, **{"Filename Prefix": "others"}))
    with pytest.raises(InputError, match="its radiographs are not beside it"):
        scan_of(path)


SYNCHROTRON = """[System]
Scanner=Beamline
[Acquisition]
Optical Axis (line)=28
Object to Source (mm)=60
Number Of Files= 6
Number Of Rows= 56
Number Of Columns= 64
Linear pixel value=0
Scaled Image Pixel Size (um)=100
Exposure (ms)=30
Rotation Step (deg)=60
Flat Field Correction=ON
Rotation Direction=CC
;Optics= 4x magnification
"""


@pytest.mark.parametrize("distance", [60, 10000001])
def test_logs_that_beamlines_write_for_nrecon(tmp_path, distance):
    """Without prefix, camera and pixels of the log: named as the images begin, pixels scaled (OPenT, BL20B2)."""
    lab = LAB if distance == 60 else Lab(parallel=True, pixel=0.1)
    write_images(tmp_path, [f"proj_{n:04d}.tif" for n in range(6)], images(lab=lab), 65535)
    path = tmp_path / "proj_.log"
    path.write_text(SYNCHROTRON.replace("(mm)=60", f"(mm)={distance}"))
    scan = scan_of(path)
    assert scan.geometry.beam == ("cone" if distance == 60 else "parallel")
    assert scan.white_level == 65535
    np.testing.assert_allclose(ball_images(scan.geometry), images(lab=lab), atol=1e-9)


@pytest.mark.parametrize("pixel", ["9.0", "200.0"])
def test_radiographs_do_not_change_with_a_camera_distance_that_is_not_told(tmp_path, pixel):
    """An axis low on the panel, of a camera whose pixels make it nearer than the axis, or farther."""
    text = changed(FILE, **{"Camera to Source (mm)": None, "Camera Pixel Size (um)": pixel, "Optical Axis (line)": 22})
    scan = scan_of(folder_of(tmp_path, text, images(lab=Lab(panel_shift=(0, (56 / 2 - 22) * 0.4)))))
    assert misfit(scan) < MAX_MISFIT
    (note,) = (f for f in scan.findings if "by which radiographs do not change" in f.fact)
    assert note.level is Level.NOTE


@pytest.mark.parametrize("text", ["2023-01-01 12:00 start\n", "angle\n0\n1\n2\n", "[Acquisition]\r\nx=1\r\n"])
def test_other_logs_are_refused_by_name(tmp_path, text):
    path = folder_of(tmp_path)
    path.write_text(text)
    with pytest.raises(InputError, match=r"beads\.log \(reference\.radiographs\): no log of a SkyScan"):
        scan_of(path)
