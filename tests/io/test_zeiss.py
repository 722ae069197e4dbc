"""Zeiss's files, as the scanner writes them: signs, flats, stopped scans, bad input.

Sources of the conventions that the file is written in: dxchange ``read_txrm`` (names of the streams), txrm2tiff
(row 0 is the lowest row of XRM Data Explorer; shifts move images to where they belong), CIL ``ZEISSDataReader``
(angles counter-clockwise; PixelSize at the sample), mbirjax ``zeiss.py`` and a reader for a Versa 410 that makes
vectors of ASTRA (CenterShift is a shift of all images).
"""

import struct
import sys

import numpy as np
import pytest
import tifffile
from txrm2tiff import open_txrm

from compound_file import write_compound_file
from experiment_scan import reference_scan
from grainmotion import read_scan
from grainmotion.errors import InputError, InputWarning
from grainmotion.experiment.inherited_keys import with_inherited_keys
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import ReferenceTable, StateTable
from grainmotion.io.scanners.identify import is_scanner_file, read_scanner_file
from grainmotion.io.stacks import find_stack
from grainmotion.model.finding import Level
from lab_scanner import Lab, ball_images

LAB = Lab()
ANGLES = np.array([0.0, 35.0, 140.0, 250.0, 305.0])
OPEN = 20000.0
CENTER_SHIFT = 1.5
SHIFTS = np.array([[0.0, 0.0], [2.0, -1.0], [-3.0, 2.0], [0.5, 1.25], [1.0, 0.0]])  # Alignment/X-Shifts, Y-Shifts


def floats(*values):
    return np.array(values, "<f4").ravel().tobytes()


def ints(*values):
    return struct.pack(f"<{len(values)}i", *values)


def counts(integrals, dtype="<u2", level=OPEN):
    values = level * np.exp(-np.asarray(integrals))
    return (np.rint(values) if np.dtype(dtype).kind == "u" else values).astype(dtype)


def streams_of(images, angles, *, lab=LAB, flat=None, told=None, kind=5, **more):
    """The streams of a scan; ``images`` as a viewer shows them, row 0 at the top."""
    n = len(images)
    magnification = lab.source_to_panel / lab.source_to_axis
    streams = {
        "Version": floats(5.0),
        "ImageInfo/ImageWidth": ints(images.shape[2]),
        "ImageInfo/ImageHeight": ints(images.shape[1]),
        "ImageInfo/NoOfImages": ints(told or n),
        "ImageInfo/ImagesTaken": ints(n),
        "ImageInfo/DataType": ints(kind),
        "ImageInfo/AcquisitionMode": ints(0),
        "ImageInfo/XrayGeometry": ints(1),
        "ImageInfo/MosiacColumns": ints(0),
        "ImageInfo/MosiacRows": ints(0),
        "ImageInfo/Angles": floats(angles),
        "ImageInfo/StoRADistance": floats([-lab.source_to_axis] * n),  # signs of the stages' travel
        "ImageInfo/DtoRADistance": floats([lab.source_to_panel - lab.source_to_axis] * n),
        "ImageInfo/PixelSize": floats(1e3 * lab.pixel / magnification),  # micrometres, at the sample
        "ImageInfo/CamPixelSize": floats(1e3 * lab.pixel * 4 / 2),  # of the camera, not binned
        "ImageInfo/CameraBinning": ints(2),
        "ImageInfo/OpticalMagnification": floats(4.0),
        "ImageInfo/ObjectiveName": b"4X\0",
        "ImageInfo/Voltage": floats(80.0),
        "ImageInfo/ExpTimes": floats([2.0] * n),
        "ImageInfo/Date": b"11/29/2026 12:00:00.00\0\0",
        "AcquisitionSettings/SrcPower": floats(7.0),
        **{f"ImageInfo/{axis}Position": floats([10.0] * n) for axis in "XYZ"},
    }
    for k, image in enumerate(images, start=1):
        streams[f"ImageData{(k - 1) // 100 + 1}/Image{k}"] = image[::-1].tobytes()
    if flat is not None:
        streams["ReferenceData/DataType"] = ints(10)
        streams["ReferenceData/Image"] = flat[::-1].astype("<f4").tobytes()
        streams["ReferenceData/ExpTime"] = floats(2.0)
        streams["ReferenceData/ImageInfo/ImageWidth"] = ints(flat.shape[1])
        streams["ReferenceData/ImageInfo/ImageHeight"] = ints(flat.shape[0])
    return {**streams, **{name.replace("__", "/"): value for name, value in more.items()}}


def uneven_flat(lab=LAB):
    rows, columns = np.indices(lab.shape)
    return OPEN * (0.8 + 0.002 * rows + 0.001 * columns)


def scan_file(path, *, lab=LAB, angles=ANGLES, **more):
    flat = uneven_flat(lab)
    integrals = lab.images(angles)
    images = np.rint(flat * np.exp(-integrals)).astype("<u2")
    write_compound_file(path, streams_of(images, angles, lab=lab, flat=flat, **more))
    return path


def test_a_scan_by_its_file_alone(tmp_path):
    path = scan_file(tmp_path / "scan.txrm")
    scan, _, findings = reference_scan(path).read_checked()
    assert len(scan.line_integrals) == len(ANGLES)
    np.testing.assert_allclose(ball_images(scan.geometry), scan.line_integrals, atol=3e-4)
    assert [f for f in findings if f.level is not Level.NOTE] == []


def test_every_wrong_sign_is_seen(tmp_path):
    right = reference_scan(scan_file(tmp_path / "scan.txrm"))
    images = right.read()[0].line_integrals
    for wrong in (
        {"angles_deg": ANGLES.tolist()},
        {"first_row": "top"},
        {"source_to_axis": 50.0},
        {"beam": "parallel"},
    ):
        geometry = reference_scan(tmp_path / "scan.txrm", geometry=wrong).geometry
        assert np.abs(ball_images(geometry) - images).max() > 0.1, wrong
    mirrored = right.geometry.vectors * np.array([1] * 6 + [-1] * 3 + [1] * 3)
    assert np.abs(ball_images(type(right.geometry)(mirrored, right.geometry.shape)) - images).max() > 0.1


def moved_axis(pixels):
    """A scanner whose axis appears ``pixels`` columns left of the middle, as a panel further to the right makes it."""
    return Lab(panel_shift=(pixels * LAB.pixel, 0.0))


def test_center_shift_moves_images_to_where_the_axis_is_in_the_middle(tmp_path):
    lab = moved_axis(CENTER_SHIFT)
    path = scan_file(tmp_path / "scan.txrm", lab=lab, ReconSettings__CenterShift=floats(CENTER_SHIFT))
    scan = reference_scan(path)
    images = scan.read()[0].line_integrals
    np.testing.assert_allclose(ball_images(scan.geometry), images, atol=3e-4)
    assert any("CenterShift" in f.fact for f in scan.findings)
    for wrong in (0.0, -CENTER_SHIFT):
        path = scan_file(tmp_path / "wrong.txrm", lab=lab, ReconSettings__CenterShift=floats(wrong))
        assert np.abs(ball_images(reference_scan(path).geometry) - images).max() > 0.05
    overridden = reference_scan(tmp_path / "scan.txrm", geometry={"detector_offset": (0.0, 0.0)})
    np.testing.assert_allclose(ball_images(overridden.geometry), Lab().images(ANGLES)[:, ::-1], atol=1e-6)


def test_shifts_move_images_to_where_they_belong(tmp_path):
    """Images of a stage that shook: features have to go X columns to the right and Y rows up to lie right."""
    labs = [Lab(panel_shift=tuple(shift * LAB.pixel)) for shift in SHIFTS]  # features left by X columns, down by Y rows
    integrals = np.stack([lab.image(angle) for lab, angle in zip(labs, ANGLES)])
    for signs in ((1, 1), (-1, 1), (1, -1)):
        more = {f"Alignment__{axis}-Shifts": floats(k * s) for axis, s, k in zip("XY", SHIFTS.T, signs)}
        write_compound_file(tmp_path / "scan.txrm", streams_of(counts(integrals), ANGLES, **more))
        geometry = reference_scan(tmp_path / "scan.txrm", kind="transmission").geometry
        error = np.abs(ball_images(geometry) - integrals[:, ::-1]).max()  # row 0 of the file is the lowest
        assert error < 1e-5 if signs == (1, 1) else error > 0.1


def test_an_independent_reader_sees_the_same_images(tmp_path):
    path = scan_file(
        tmp_path / "scan.txrm", **{"Alignment__X-Shifts": floats([0] * 5), "Alignment__Y-Shifts": floats([0] * 5)}
    )
    with open_txrm(path) as other:
        stored, shown = other.get_images(), other.get_output(load=True, clear_images=False)
        reference, angles = other.get_reference(), other.image_info["Angles"]
    np.testing.assert_array_equal(find_stack(path).read(), stored)
    np.testing.assert_array_equal(find_stack(f"{path}::ReferenceData").read()[0], reference)
    np.testing.assert_allclose(angles, ANGLES)
    np.testing.assert_allclose(-np.log(shown / uneven_flat()), LAB.images(ANGLES), atol=3e-4)  # row 0 at the top


def test_some_images_are_read_alone(tmp_path):
    path = scan_file(tmp_path / "scan.txrm", angles=np.linspace(0, 720, 121))  # more than one storage, two turns
    stack = find_stack(path)
    assert stack.info()[0] == (121, *LAB.shape)
    np.testing.assert_array_equal(stack.read(np.array([100, 3])), stack.read()[[100, 3]])
    np.testing.assert_allclose(read_scanner_file(path).circle.angles_deg, -np.linspace(0, 720, 121), atol=1e-4)


def test_a_parallel_beam_has_its_pixels_at_the_sample(tmp_path):
    lab = Lab(parallel=True)
    more = {"ImageInfo__XrayGeometry": ints(0), "ImageInfo__PixelSize": floats(1e3 * lab.pixel)}
    path = scan_file(tmp_path / "scan.txrm", lab=lab, **more)
    scan = reference_scan(path)
    assert scan.geometry.beam == "parallel"
    np.testing.assert_allclose(ball_images(scan.geometry), scan.read()[0].line_integrals, atol=3e-4)


def test_several_images_of_the_open_beam_are_averaged(tmp_path):
    images = counts(LAB.images(ANGLES))
    multi = {
        f"MultiReferenceData__Image{k}": np.full(LAB.shape, OPEN + d, "<u2").tobytes() for k, d in ((1, 90), (2, -90))
    }
    streams = streams_of(images, ANGLES, MultiReferenceData__DataType=ints(5), **multi)
    write_compound_file(tmp_path / "scan.txrm", streams)
    scan = reference_scan(tmp_path / "scan.txrm").read()[0]
    np.testing.assert_allclose(ball_images(scan.geometry), scan.line_integrals, atol=3e-4)


def test_flats_of_another_exposure_are_scaled(tmp_path):
    """Exposures of a scan differ from that of the flats, and from view to view."""
    times = np.array([2.0, 2.0, 3.0, 3.0, 4.0])
    images = np.stack([counts(i, level=OPEN * t / 4) for i, t in zip(LAB.images(ANGLES), times)])
    flat = np.full(LAB.shape, OPEN)
    more = {"ImageInfo__ExpTimes": floats(times), "ReferenceData__ExpTime": floats(4.0)}
    write_compound_file(tmp_path / "scan.txrm", streams_of(images, ANGLES, flat=flat, **more))
    scan = reference_scan(tmp_path / "scan.txrm").read()[0]
    np.testing.assert_allclose(ball_images(scan.geometry), scan.line_integrals, atol=1e-3)
    np.save(tmp_path / "flat.npy", flat / 2)  # the user's own flats have their own exposure, which no file tells
    assert reference_scan(tmp_path / "scan.txrm", flats=[str(tmp_path / "flat.npy")]).monitor is None


def test_a_stopped_scan_uses_what_is_there(tmp_path):
    path = scan_file(tmp_path / "scan.txrm", told=1601)
    scan = reference_scan(path)
    assert len(scan.geometry) == len(ANGLES)
    assert any("5 of 1601 images" in f.fact and f.level is Level.WARNING for f in scan.findings)
    with pytest.warns(InputWarning, match="5 of 1601 images"):
        read_scan(path, str(path))


def test_files_of_one_radiograph_each(tmp_path):
    for k, (angle, shift) in enumerate(zip(ANGLES, SHIFTS)):
        lab = Lab(panel_shift=tuple(shift * LAB.pixel))
        more = {f"Alignment__{axis}-Shifts": floats(s) for axis, s in zip("XY", shift)} if shift.any() else {}
        scan_file(tmp_path / f"view{k}.xrm", lab=lab, angles=[angle], **more)
    for files in (["view*.xrm"], [f"view{k}.xrm" for k in range(len(ANGLES))]):
        scan = reference_scan(tmp_path / "view0.xrm", radiographs=files)
        np.testing.assert_allclose(ball_images(scan.geometry), scan.read()[0].line_integrals, atol=3e-4)
    scan_file(tmp_path / "view5.xrm", lab=Lab(source_to_axis=70.0), angles=[0.0])
    with pytest.raises(
        InputError, match=r"view5\.xrm \(reference.radiographs\): its \w+ is .*, but that of view0\.xrm is"
    ):
        reference_scan(tmp_path / "view0.xrm", radiographs=["view*.xrm"])


def test_a_state_beside_its_reference(tmp_path):
    """The state's file has no flats: those of the reference serve; bare images have all but the angles from it."""
    scan_file(tmp_path / "scan.txrm", lab=moved_axis(CENTER_SHIFT), ReconSettings__CenterShift=floats(CENTER_SHIFT))
    angles = ANGLES[1:4]
    images = np.rint(uneven_flat() * np.exp(-moved_axis(CENTER_SHIFT).images(angles))).astype("<u2")
    write_compound_file(tmp_path / "state.txrm", streams_of(images, angles))
    tifffile.imwrite(tmp_path / "bare.tif", images[:, ::-1], photometric="minisblack")
    geometry = {"angles_deg": (-angles).tolist(), "first_row": "bottom"}
    states = [
        {"name": "a", "radiographs": "state.txrm"},
        {"name": "b", "radiographs": "bare.tif", "geometry": geometry},
    ]
    tables = with_inherited_keys({"reference": {"radiographs": "scan.txrm"}, "states": states})
    reference = ReferenceTable.model_validate(tables["reference"])
    for state in tables["states"]:
        table = StateTable.model_validate(state)
        scan = find_scan(f"states.{table.name}", table, reference, tmp_path)
        np.testing.assert_allclose(ball_images(scan.geometry), scan.read()[0].line_integrals, atol=3e-4)


def test_rows_of_bare_images_beside_a_reference_are_asked_for(tmp_path):
    """Zeiss's software exports TIFF with row 0 at the top, other programs as it is in the file, at the bottom."""
    scan_file(tmp_path / "scan.txrm")
    tifffile.imwrite(tmp_path / "bare.tif", np.full((2, 56, 64), 9000, np.uint16), photometric="minisblack")
    states = [{"name": "b", "radiographs": "bare.tif", "geometry": {"angles_deg": [0, 90]}}]
    tables = with_inherited_keys({"reference": {"radiographs": "scan.txrm"}, "states": states})
    reference, state = (
        ReferenceTable.model_validate(tables["reference"]),
        StateTable.model_validate(tables["states"][0]),
    )
    with pytest.raises(InputError, match=r"states\.b\.geometry\.first_row: it is missing; scan\.txrm does not tell it"):
        find_scan("states.b", state, reference, tmp_path)


def test_single_radiographs(tmp_path):
    """Files of one radiograph each, of which the table gives the geometry, and flats of another."""
    paths = [scan_file(tmp_path / f"view{k}.xrm", angles=ANGLES[k : k + 1]) for k in range(3)]
    assert len(reference_scan(paths[1]).geometry) == 1
    circle = {"angles_deg": (-ANGLES[:3]).tolist(), "pixel_size": 0.4, "first_row": "bottom"}
    circle |= {"source_to_axis": 60.0, "source_to_detector": 240.0}
    table = ReferenceTable(radiographs=["view*.xrm"], flats=["view0.xrm::ReferenceData"], geometry=circle)
    scan = find_scan("reference", table, table, tmp_path).read()[0]
    np.testing.assert_allclose(ball_images(scan.geometry), scan.line_integrals, atol=3e-4)


def test_what_inspect_can_show(tmp_path):
    facts = dict(read_scanner_file(scan_file(tmp_path / "scan.txrm")).facts)
    assert facts["Voltage"] == "80 kV"
    assert facts["Power"] == "7 W"
    assert facts["Objective"] == "4X"
    assert facts["Date"].startswith("11/29/2026")


@pytest.mark.parametrize(
    ("streams", "fact"),
    [
        ({"ImageInfo__MosiacColumns": ints(2), "ImageInfo__MosiacRows": ints(3)}, "a mosaic of 2 x 3 images"),
        (
            {"ImageInfo__Angles": floats([0.0, 1.0])},
            "ImageInfo/Angles has 2 numbers, not one finite number for each of 5",
        ),
        ({"ImageInfo__Angles": floats([0, 1, np.nan, 3, 4])}, "ImageInfo/Angles has 5 numbers, not one finite"),
        ({"Alignment__X-Shifts": floats([1, 2, np.inf, 3, 4])}, "Alignment/X-Shifts has 5 numbers"),
        ({"ImageInfo__DataType": ints(12)}, r"the type 12 \(DataType\), which is not known; export the scan as 16-bit"),
        (
            {"ImageInfo__ImageWidth": ints(2**31 - 1)},
            r"ImageData1/Image1 has 7168 bytes, but \(56, 2147483647\) pixels",
        ),
        ({"ImageInfo__ImageWidth": ints(-3)}, "ImageWidth and ImageHeight are missing or not positive"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, streams, fact):
    path = scan_file(tmp_path / "scan.txrm", **streams)
    with pytest.raises(InputError, match=rf"scan\.txrm.*{fact}") as error:
        reference_scan(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("streams", "fact"),
    [
        ({"ImageInfo__StoRADistance": floats([60, 60, 61, 62, 63])}, "StoRADistance changes from 60 to 63 mm"),
        ({"ImageInfo__DtoRADistance": floats([180000.0] * 5)}, "DtoRADistance is 180000, which is no distance in mm"),
    ],
)
def test_distances_that_cannot_be_are_asked_for(tmp_path, streams, fact):
    path = scan_file(tmp_path / "scan.txrm", **streams)
    assert any(fact in f.fact for f in read_scanner_file(path).findings)
    with pytest.raises(InputError, match=rf"reference\.geometry\.\w+: it is missing.*does not tell it: {fact}"):
        reference_scan(path)
    geometry = {"source_to_axis": 60.0, "source_to_detector": 240.0, "pixel_size": 0.4}
    scan = reference_scan(path, geometry=geometry)
    np.testing.assert_allclose(ball_images(scan.geometry), scan.read()[0].line_integrals, atol=3e-4)


def test_micrometres_by_the_unit_of_the_axis(tmp_path):
    more = {"PositionInfo__AxisNames": b"Sample X\0\0Source Z\0", "PositionInfo__AxisUnits": b"um\0\0um\0"}
    more |= {"ImageInfo__StoRADistance": floats([-6e4] * 5), "ImageInfo__DtoRADistance": floats([18e4] * 5)}
    circle = read_scanner_file(scan_file(tmp_path / "scan.txrm", **more)).circle
    assert (circle.source_to_axis, circle.source_to_detector) == pytest.approx((60.0, 240.0))


def test_two_centers_that_differ_are_named(tmp_path):
    more = {"ReconSettings__CenterShift": floats(1.5), "AutoRecon__CenterShift": floats(-4.0)}
    file = read_scanner_file(scan_file(tmp_path / "scan.txrm", **more))
    assert file.circle.detector_offset == pytest.approx((1.5 * LAB.pixel, 0))
    assert any("1.5 columns left of the middle, but that of AutoRecon is -4" in f.fact for f in file.findings)


def test_doubtful_numbers_are_named(tmp_path):
    more = {"ImageInfo__CamPixelSize": floats(130.0), "ImageInfo__XPosition": floats([0, 0, 500, 0, 0])}
    findings = read_scanner_file(scan_file(tmp_path / "scan.txrm", **more)).findings
    assert any("OpticalMagnification make 65 um" in f.fact for f in findings)
    assert any("the stage moved during the scan" in f.fact and "X 0 to 500 um" in f.evidence for f in findings)


def test_flats_of_another_size_are_refused(tmp_path):
    more = {"ReferenceData__Image": np.full((28, 32), OPEN, "<f4").tobytes()}
    more |= {"ReferenceData__ImageInfo__ImageWidth": ints(32), "ReferenceData__ImageInfo__ImageHeight": ints(28)}
    path = scan_file(tmp_path / "scan.txrm", **more)
    with pytest.raises(InputError, match=r"images of \(28, 32\) pixels, but the radiographs have \(56, 64\)"):
        reference_scan(path)


def test_foreign_and_truncated_files(tmp_path):
    (tmp_path / "a.txrm").write_bytes(b"II*\0 a TIFF file by another name")
    with pytest.raises(InputError, match=r"a\.txrm.*it is no OLE compound file"):
        reference_scan(tmp_path / "a.txrm")
    write_compound_file(tmp_path / "b.txrm", {"WordDocument": b"a letter" * 1000})
    with pytest.raises(InputError, match=r"b\.txrm.*it holds no radiograph"):
        reference_scan(tmp_path / "b.txrm")
    whole = scan_file(tmp_path / "whole.txrm").read_bytes()
    for share in (0.02, 0.3, 0.6, 0.9, 0.999):
        (tmp_path / "c.txrm").write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(InputError, match=r"c\.txrm") as error:
            reference_scan(tmp_path / "c.txrm").read()
        assert "\n" not in str(error.value)


def test_an_image_that_is_too_short_is_named(tmp_path):
    path = scan_file(tmp_path / "scan.txrm", ImageData1__Image3=b"\0" * 100)
    with pytest.raises(InputError, match="ImageData1/Image3 has 100 bytes"):
        find_stack(path).read()


def test_reconstructed_volumes_are_refused(tmp_path):
    (tmp_path / "a.txm").write_bytes(b"x")
    assert not is_scanner_file("a.txm")
    with pytest.raises(
        InputError, match=r"a\.txm: a volume that Zeiss's software has reconstructed; give the radiographs"
    ):
        find_stack(tmp_path / "a.txm")


def test_without_olefile_the_error_says_what_to_install(tmp_path, monkeypatch):
    path = scan_file(tmp_path / "scan.txrm")
    monkeypatch.setitem(sys.modules, "olefile", None)
    with pytest.raises(InputError, match=r'need the package olefile.*pip install "grainmotion\[scanners\]"'):
        reference_scan(path)
