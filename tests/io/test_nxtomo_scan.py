"""NXtomo files of an independent writer: geometry that reproduces the images of an asymmetric object, sign by sign."""

import h5py
import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.scanners.identify import read_scanner_file
from grainmotion.model.finding import Level
from lab_scanner import Lab
from nxtomo_library import write_with_nxtomo
from read_experiment_scan import misfit, reference_of

STAGE = np.array([0.0, 35.0, 140.0, 250.0])
LAB = Lab(axis_shift=0.3)  # the axis is seen 3 columns right of the middle, at 34.5
COLUMN = (LAB.shape[1] - 1) / 2 + 3.0
SAME = 2e-3  # counts are rounded: 1/40000 of the open beam behind e^1.3
WRONG = 0.05
TOML = '[reference]\nradiographs = "scan.nx"\n'
ENTRY = "entry0000"


@pytest.fixture
def scan(tmp_path):
    """Writes a file and changes datasets in it: None deletes, (value, unit) or a value sets."""

    def write(lab=LAB, changes=None, **keys):
        (tmp_path / "scan.nx").unlink(missing_ok=True)
        path = write_with_nxtomo(tmp_path / "scan.nx", lab, STAGE, **keys)
        with h5py.File(path, "a") as file:
            entry = file[ENTRY]
            for name, value in {
                "instrument/detector/x_rotation_axis_pixel_position": COLUMN,
                **(changes or {}),
            }.items():
                attributes = dict(entry[name].attrs) if name in entry else {}
                if name in entry:
                    del entry[name]
                if value is None:
                    continue
                entry[name] = value[0] if isinstance(value, tuple) else value
                if isinstance(value, tuple):
                    attributes["units"] = value[1]
                entry[name].attrs.update(attributes)
        return path

    return write


def read(path, extra=""):
    return reference_of(path.parent, TOML + extra)


class TestFileAlone:
    """Radiographs = "scan.nx" is enough."""

    @pytest.mark.parametrize("flips", [(False, False), (True, False), (False, True), (True, True)])
    def test_cone_beam_with_every_flip(self, scan, flips):
        changes = {}
        if flips[0]:  # the axis is where it is in the frames as they are stored
            changes = {"instrument/detector/x_rotation_axis_pixel_position": LAB.shape[1] - 1 - COLUMN}
        source = read(scan(flips=flips, changes=changes))
        assert source.geometry.beam == "cone"
        assert misfit(source) < SAME

    def test_parallel_beam_of_a_synchrotron(self, scan):
        lab = Lab(parallel=True, pixel=0.15, axis_shift=0.45)
        source = read(scan(lab, source_type="Synchrotron X-ray Source", distances=False))
        assert source.geometry.beam == "parallel"
        assert misfit(source) < SAME

    @pytest.mark.parametrize(
        "changes",
        [
            {"instrument/source/distance": (0.06, "m")},  # of writers that leave out the sign
            {"instrument/source/distance": (-60.0, "mm"), "instrument/detector/distance": (18.0, "cm")},
            {"instrument/detector/x_rotation_axis_pixel_position": 3.0},  # from the middle, as the ESRF's converter
            {"instrument/detector/x_rotation_axis_pixel_position": None,
             "instrument/detector/estimated_cor_from_motor": 3.0},
            {"instrument/detector/x_pixel_size": (400.0, "µm"), "instrument/detector/y_pixel_size": (400.0, b"um")},
        ],
    )  # fmt: skip
    def test_other_ways_to_write_the_same(self, scan, changes):
        assert misfit(read(scan(changes=changes))) < SAME

    def test_pixel_at_the_sample_is_magnified(self, scan):
        changes = {"instrument/detector/x_pixel_size": None, "instrument/detector/y_pixel_size": None}
        assert misfit(read(scan(sample_pixel=0.1, changes=changes))) < SAME

    def test_flats_at_both_ends_are_averaged_and_other_frames_left_out(self, scan):
        source = read(scan())
        assert source.radiographs.info()[0][0] == len(STAGE)
        assert source.flats is not None
        assert source.flats.info()[0][0] == 2
        assert source.darks is not None
        assert source.darks.info()[0][0] == 1


class TestWrongSigns:
    """Each sign in a file matters: with the other one the images are others."""

    @pytest.mark.parametrize(
        "changes",
        [
            {"instrument/detector/transformations/ry": 180.0},
            {"instrument/detector/transformations/rx": 180.0},
            {"instrument/detector/x_rotation_axis_pixel_position": LAB.shape[1] - 1 - COLUMN},
            {"instrument/source/distance": (-0.09, "m")},
            {"instrument/detector/distance": (0.12, "m")},
            {"sample/rotation_angle": -np.array([0, 0, 0, 35, 0, 0, 140, 250, 250.0])},
        ],
        ids=["mirrored", "upside down", "axis", "source", "panel", "sense"],
    )
    def test_images_differ(self, scan, changes):
        assert misfit(read(scan(changes=changes))) > WRONG

    def test_without_the_axis_direction_the_stage_turns_clockwise(self, scan):
        assert misfit(read(scan(counter_clockwise=False))) < SAME
        path = scan()
        with h5py.File(path, "a") as file:
            del file[f"{ENTRY}/sample/rotation_angle"].attrs["vector"]
        assert misfit(read(path)) > WRONG


class TestOlderFrame:
    """Before version 2 the ESRF's files have z up and x along the beam, and a pixel at the sample."""

    def older(self, scan, axis, flips):
        path = scan(flips=flips, changes={"instrument/detector/x_pixel_size": (1e-4, "m"),
                    "instrument/detector/y_pixel_size": (1e-4, "m")})  # fmt: skip
        with h5py.File(path, "a") as file:
            file[ENTRY].attrs["version"] = 1.4
            del file[ENTRY].attrs["NeXus_Coordinate_System"]
            group = file[f"{ENTRY}/instrument/detector/transformations"]
            del group["rx"], group["ry"]
            for name, vector in (("rz", (0, 0, 1)), ("ry", (0, 1, 0))):
                group[name] = 180.0 if name == axis else 0.0
                group[name].attrs.update(transformation_type="rotation", vector=vector, units="degree")
            file[f"{ENTRY}/sample/rotation_angle"].attrs["vector"] = (0.0, 0.0, 1.0)
            name = f"{ENTRY}/instrument/detector/x_rotation_axis_pixel_position"
            if flips[0]:
                file[name][...] = LAB.shape[1] - 1 - COLUMN
        return read(path)

    @pytest.mark.parametrize(("axis", "flips"), [("", (False, False)), ("rz", (True, False)), ("ry", (False, True))])
    def test_flips_are_those_about_z_and_y(self, scan, axis, flips):
        assert misfit(self.older(scan, axis, flips)) < SAME

    def test_the_other_axis_is_seen(self, scan):
        assert misfit(self.older(scan, "ry", (True, False))) > WRONG


class TestAsked:
    """What the file does not tell, or tells in two ways, is asked for by the key, with the reason."""

    @pytest.mark.parametrize(
        ("changes", "keys", "match"),
        [
            ({"instrument/detector/x_pixel_size": 0.0004, "instrument/detector/y_pixel_size": None}, {},
             r"pixel_size: it is missing; scan.nx does not tell it: .*x_pixel_size has no unit"),
            ({"instrument/detector/x_pixel_size": (0.4, "deg")}, {}, "unit 'deg', which is no length"),
            ({"instrument/detector/y_pixel_size": (5e-4, "m")}, {}, "no squares"),
            ({"instrument/detector/distance": None}, {}, "source_to_detector: it is missing"),
            ({"instrument/detector/distance": None}, {"sample_pixel": 0.1}, "is missing.*at the sample, times"),
            ({"instrument/source/distance": (np.nan, "m")}, {}, "source_to_axis: it is missing.*is nan"),
            ({}, {"flips": None}, "first_row: it is missing"),
            ({"sample/rotation_angle": None}, {}, "angles_deg: it is missing; scan.nx .*rotation_angle is not there"),
            ({"sample/rotation_angle": np.r_[0, 0, np.nan, np.zeros(6)]}, {}, "is no number in 1 frames"),
            ({"instrument/detector/image_key": np.full(9, 1)}, {}, "no frame of /entry0000 is a radiograph"),
            ({"instrument/source/type": None}, {"distances": False}, r'source_to_axis: it is missing.*"parallel"'),
            ({"instrument/source/type": None}, {"distances": False, "sample_pixel": 0.04},
             r"pixel_size: it is missing.*0.04 mm at the sample, 0.4 mm on the panel"),
            ({"instrument/detector/magnification": 10.0},
             {"source_type": "Synchrotron X-ray Source", "distances": False}, "magnification of 10 or after"),
        ],
    )  # fmt: skip
    def test_missing_numbers(self, scan, changes, keys, match):
        path = scan(changes=changes, **keys)
        if "y_pixel_size" in str(changes) and changes.get("instrument/detector/y_pixel_size", 1) is None:
            with h5py.File(path, "a") as file:
                del file[f"{ENTRY}/instrument/detector/x_pixel_size"]
                file[f"{ENTRY}/instrument/detector/x_pixel_size"] = 0.0004
        with pytest.raises(InputError, match=match) as error:
            read(path)
        assert all(line.startswith("  also ") for line in str(error.value).splitlines()[1:])

    def test_the_panel_follows_from_the_told_source(self, scan):
        path = scan(Lab(panel_shift=(-1.2, 0.0)), distances=False)
        with pytest.raises(InputError, match="source_to_axis"):
            read(path)
        source = read(path, "[reference.geometry]\nsource_to_axis = 60\n")
        assert misfit(source) < SAME
        np.testing.assert_allclose(source.geometry.project_points([[0, 0, 0]])[:, 0, 1], COLUMN, atol=1e-9)

    def test_a_parallel_beam_with_distances_of_a_source_is_a_contradiction(self, scan):
        path = scan(source_type="Synchrotron X-ray Source", distances=False)
        distances = "[reference.geometry]\nsource_to_axis = 60\nsource_to_detector = 240\n"
        with pytest.raises(InputError, match=r'source_to_axis: it is given.*parallel beam; set beam = "cone"'):
            read(path, distances)
        assert read(path, distances + 'beam = "cone"\n').geometry.beam == "cone"


class TestNamed:
    """What was assumed or is unusual is named."""

    def facts(self, path):
        return [(f.level, f.fact) for f in read_scanner_file(path).findings]

    def test_an_axis_that_may_be_counted_in_two_ways_is_not_used(self, scan):
        half = {"instrument/detector/half_acquisition": True}
        ((level, fact),) = self.facts(scan(changes=half))
        assert level is Level.WARNING
        assert "34.5 of 64 columns: whether from the left or from the middle" in fact
        ((_, fact),) = self.facts(scan(changes={"instrument/detector/x_rotation_axis_pixel_position": 60.0}))
        assert "60 of 64" in fact
        ((_, fact),) = self.facts(scan(changes={"instrument/detector/x_rotation_axis_pixel_position": -500.0}))
        assert "-500 of 64" in fact
        assert self.facts(scan()) == []

    def test_a_source_far_away_gives_parallel_rays(self, scan):
        changes = {"instrument/source/distance": (-145.0, "m"), "instrument/source/type": b"Synchrotron X-ray Source"}
        path = scan(Lab(parallel=True, pixel=0.15, axis_shift=0.45), changes=changes, sample_pixel=0.15)
        assert misfit(read(path)) < SAME
        ((level, fact),) = self.facts(path)
        assert level is Level.NOTE
        assert "145 m away" in fact

    def test_another_scan_in_the_file(self, scan):
        path = scan()
        with h5py.File(path, "a") as file:
            file.copy(ENTRY, "entry0001")
        ((_, fact),) = self.facts(path)
        assert "entry0001" in fact

    def test_a_tilt_of_the_panel_is_not_used(self, scan):
        ((_, fact),) = self.facts(scan(changes={"instrument/detector/transformations/rx": 3.0}))
        assert "rx were not used" in fact

    @pytest.mark.parametrize(("vector", "count"), [("up", 0), ((1, 2), 0), ((0, 0, 0), 0), ((1.0, 0, 0), 1)])
    def test_an_axis_that_is_not_upright(self, scan, vector, count):
        path = scan()
        with h5py.File(path, "a") as file:
            file[f"{ENTRY}/sample/rotation_angle"].attrs["vector"] = vector
            file[f"{ENTRY}/instrument/detector/transformations/rx"].attrs["vector"] = "x"
        found = self.facts(path)
        assert len(found) == count
        assert all("is not upright" in fact for _, fact in found)

    def test_angles_of_the_experiment_file(self, scan):
        source = read(scan(), "[reference.geometry]\nangles_deg = [0, 1, 2, 3]\n")
        (note,) = [f for f in source.findings if f.check == "sizes"]
        assert note.where == "reference.geometry.angles_deg"
        assert note.level is Level.NOTE

    def test_flips_that_contradict_each_other(self, scan):
        with pytest.raises(InputError, match="x_flipped contradicts"):
            read_scanner_file(scan(changes={"instrument/detector/x_flipped": True}))

    @pytest.mark.parametrize(
        ("key", "told", "level"),
        [("pixel_size", "0.5", Level.WARNING), ("source_to_axis", "70", Level.WARNING), ("pixel_size", "0.401", None),
         ("pixel_size", "0.1", Level.WARNING), ("axis_offset", "0.0", Level.NOTE), ("axis_offset", "0.3", None)],
    )  # fmt: skip
    def test_numbers_of_the_experiment_file_win_and_contradictions_are_named(self, scan, key, told, level):
        source = read(scan(), f"[reference.geometry]\n{key} = {told}\n")
        found = [f for f in source.findings if f.check == "sizes"]
        assert [f.level for f in found] == ([] if level is None else [level])
        assert source.circle is not None
        assert getattr(source.circle, key) == float(told)

    def test_facts(self, scan):
        facts = dict(read_scanner_file(scan()).facts)
        assert facts["Sample"] == "four balls"
        assert facts["Rotation axis"] == "column 34.5"


STATES = """[reference]
radiographs = "scan.nx"
[[states]]
name = "file"
radiographs = "later.nx"
[[states]]
name = "images"
radiographs = "images/*.tif"
geometry = { angles_deg = "names" }
"""


def test_states_by_a_file_of_their_own_or_bare_images_of_the_same_camera(tmp_path):
    """The camera mirrors its frames: the state's images are mirrored as the reference's, and have its axis."""
    for name, stage in (("scan.nx", STAGE), ("later.nx", STAGE + 7)):
        path = write_with_nxtomo(tmp_path / name, LAB, stage, flips=(True, False))
        with h5py.File(path, "a") as file:
            file[f"{ENTRY}/instrument/detector/x_rotation_axis_pixel_position"] = LAB.shape[1] - 1 - COLUMN
    (tmp_path / "images").mkdir()
    for angle in (12.5, 102.5, 192.5):
        counts = np.round(100 + 40_000 * np.exp(-LAB.image(angle)))[:, ::-1].astype(np.uint16)
        tifffile.imwrite(tmp_path / "images" / f"r_{-angle:+.1f}.tif", counts)
    (tmp_path / "experiment.toml").write_text(STATES)
    states = find_inputs(read_experiment(tmp_path / "experiment.toml")).states
    assert [len(state.geometry) for state in states] == [4, 3]
    for state in states:
        assert misfit(state) < SAME


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n" + b"\0" * 50, b"hello"])
def test_truncated_and_foreign_files(tmp_path, content):
    (tmp_path / "scan.nx").write_bytes(content)
    with pytest.raises(InputError, match=r"scan\.nx") as error:
        read(tmp_path / "scan.nx")
    assert "\n" not in str(error.value)


def test_the_file_is_opened_a_few_times_only(scan, monkeypatch):
    path, opened = scan(), []
    of_file = h5py.File.__init__

    def count(self, name, *args, **kwargs):
        opened.extend([name] if str(name) == str(path) else [])
        of_file(self, name, *args, **kwargs)

    monkeypatch.setattr(h5py.File, "__init__", count)
    source = read(path)
    assert len(opened) <= 4  # its format, its frames, the scanner's numbers, and the frames of the stack
    source.read()
    assert len(opened) <= 7  # and once for radiographs, flats and darks
