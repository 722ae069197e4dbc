"""Data Exchange files, written with h5py by the definition: geometry that reproduces the images of the balls."""

import h5py
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.scanners.identify import read_scanner_file
from grainmotion.model.finding import Level
from lab_scanner import Lab
from read_experiment_scan import misfit, reference_of

STAGE = np.array([0.0, 35.0, 140.0, 250.0])
LAB = Lab(parallel=True, pixel=0.15, panel_shift=(0.3, 0.0))
SAME, WRONG = 2e-3, 0.05
DETECTOR = "measurement/instrument/detector"
TOML = '[reference]\nradiographs = "scan.h5"\n[reference.geometry]\nfirst_row = "top"\ndetector_offset = [0.3, 0]\n'


@pytest.fixture
def scan(tmp_path):
    """Writes a file and changes datasets in it: None deletes, (value, unit) sets."""

    def write(changes=None, lab=LAB):
        counts = np.round(100 + 40_000 * np.exp(-lab.images(STAGE))).astype(np.uint16)
        content = {
            "implements": (b"exchange:measurement", ""),
            "exchange/data": (counts, "counts"),
            "exchange/data_white": (np.full((3, *lab.shape), 40_100, np.uint16), "counts"),
            "exchange/data_dark": (np.full((2, *lab.shape), 100, np.uint16), "counts"),
            "exchange/theta": (-STAGE, "deg"),
            f"{DETECTOR}/pixel_size_x": (0.75e-3, "m"),
            f"{DETECTOR}/objective/magnification": (5.0, ""),
            "measurement/instrument/monochromator/energy": (27.4, "keV"),
            "measurement/sample/name": (b"balls", ""),
        } | (changes or {})
        with h5py.File(tmp_path / "scan.h5", "w") as file:
            for name, item in content.items():
                if item is not None:
                    file[name] = item[0]
                    file[name].attrs.update({"units": item[1]} if item[1] else {})
        return tmp_path / "scan.h5"

    return write


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"exchange/theta": (np.deg2rad(-STAGE), b"rad")},
        {"exchange/theta": (-STAGE, "")},  # 250 cannot be radians
        {f"{DETECTOR}/actual_pixel_size_x": (150.0, "microns")},
        {f"{DETECTOR}/pixel_size_x": (0.75e-3, "")},  # SI, where no unit is named
        {f"{DETECTOR}/pixel_size_x": None, f"{DETECTOR}/objective/resolution": (150.0, "um")},
    ],
)  # fmt: skip
def test_the_file_gives_all_but_the_rows(scan, changes):
    source = reference_of(scan(changes).parent, TOML)
    assert source.geometry.beam == "parallel"
    assert misfit(source) < SAME


def test_flats_before_and_after_the_scan(scan):
    """As the Swiss Light Source names them."""
    flats = {f"exchange/data_white_{when}": (np.full((2, *LAB.shape), n, np.uint16), "counts")
             for when, n in (("pre", 40_000), ("post", 40_200))}  # fmt: skip
    source = reference_of(scan({"exchange/data_white": None, **flats}).parent, TOML)
    assert source.flats.info()[0][0] == 4
    assert misfit(source) < SAME


@pytest.mark.parametrize(
    "changes", [{"exchange/theta": (STAGE, "deg")}, {f"{DETECTOR}/objective/magnification": (10.0, "")}]
)
def test_wrong_numbers_are_seen(scan, changes):
    assert misfit(reference_of(scan(changes).parent, TOML)) > WRONG


def test_without_the_direction_of_rows_it_is_asked_for(scan):
    with pytest.raises(InputError, match=r"reference\.geometry\.first_row: it is missing"):
        reference_of(scan().parent, '[reference]\nradiographs = "scan.h5"\n')


def test_a_cone_beam_if_told(scan):
    lab = Lab(panel_shift=(0.3, 0.0))
    scan({f"{DETECTOR}/pixel_size_x": (0.4, "mm"), f"{DETECTOR}/objective/magnification": None}, lab)
    distances = "source_to_axis = 60\nsource_to_detector = 240\n"
    path = scan({f"{DETECTOR}/pixel_size_x": (0.4, "mm"), f"{DETECTOR}/objective/magnification": None}, lab)
    assert misfit(reference_of(path.parent, TOML + distances + 'beam = "cone"\n')) < SAME
    with pytest.raises(InputError, match="is of a parallel beam"):
        reference_of(path.parent, TOML + distances)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"exchange/theta": None}, "angles_deg: it is missing; scan.h5 does not tell it: it holds no theta"),
        ({"exchange/theta": (np.linspace(0, 3.1, 4), "")}, "it is missing.*theta spans 3.1 and names no unit"),
        ({"exchange/theta": (-STAGE, "furlong")}, "unknown unit 'furlong'"),
        ({"exchange/theta": (-STAGE[:3], "deg")}, r"exchange/theta .*: 3 angles for 4 frames"),
        ({"exchange/theta": (np.full(4, np.nan), "deg")}, "angles_deg: it is missing.*not finite"),
        ({f"{DETECTOR}/pixel_size_x": (6.5, "")}, r"pixel_size: it is missing.*pixel_size_x is 6500 mm.*no unit"),
        ({f"{DETECTOR}/pixel_size_x": (6.5, "s")}, "pixel_size: it is missing.*unit 's', which is no length"),
        ({"exchange/data": None}, r"exchange/data .*: it is missing"),
        ({"exchange/data": (np.ones((4, 4)), "")}, r"exchange/data .*: its shape \(4, 4\)"),
        ({"exchange/data_white": None}, r"reference.flats: it is missing"),
        ({"exchange/data_white": (np.ones((2, 9, 9)), "")}, r"images of \(9, 9\) pixels"),
    ],
)  # fmt: skip
def test_what_the_file_lacks_or_tells_wrongly(scan, changes, match):
    with pytest.raises(InputError, match=match) as error:
        reference_of(scan(changes).parent, TOML)
    assert "\n" not in str(error.value)


def test_missing_angles_may_be_given(scan):
    path = scan({"exchange/theta": None})
    assert misfit(reference_of(path.parent, TOML + f"angles_deg = {(-STAGE).tolist()}\n")) < SAME


def test_sinograms_are_refused(scan):
    path = scan()
    with h5py.File(path, "a") as file:
        file["exchange/data"].attrs["axes"] = "y:theta:x"
    with pytest.raises(InputError, match="its axes are y:theta:x: sinograms"):
        read_scanner_file(path)


def test_several_scans_in_a_file_are_named(scan):
    path = scan()
    with h5py.File(path, "a") as file:
        file.copy("exchange", "exchange_2")
    (finding,) = read_scanner_file(path).findings
    assert (finding.level, "exchange_2" in finding.fact) == (Level.NOTE, True)
    for part in (
        "exchange_2/data_white",
        'angles_deg = "scan.h5::/exchange_2/theta"',
    ):  # they do not come by themselves
        assert part in finding.remedy
    with h5py.File(path, "a") as file:
        file.move("exchange", "exchange_1")
    with pytest.raises(InputError, match=r'several scans: exchange_1, exchange_2.*"scan\.h5::/exchange_1/data"'):
        read_scanner_file(path)


def test_shifts_of_unknown_sense_are_not_used(scan):
    (finding,) = read_scanner_file(scan({"exchange/data_shift_x": (np.array([0.0, 1, 2, 3]), "")})).findings
    assert finding.level is Level.WARNING
    assert "data_shift_x" in finding.fact


def test_facts(scan):
    assert dict(read_scanner_file(scan()).facts) == {"Sample": "balls", "Energy": "27.4 keV"}


def test_a_file_of_neither_kind(tmp_path):
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        file["entry/frames"] = np.ones((4, 5, 6))
    with pytest.raises(InputError, match=r"no NXtomo entry .*no group exchange; it holds /entry/frames"):
        reference_of(tmp_path, TOML)
