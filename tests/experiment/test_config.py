"""The experiment file: what it says, what it inherits, what it refuses."""

import h5py
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import Air, read_experiment
from grainmotion.experiment.inputs import check_plausible, find_inputs
from grainmotion.experiment.scan_inputs import read_scan
from grainmotion.model.geometry import DetectorAlignment, Geometry
from grainmotion.model.volume import Volume
from tiny_experiment import PANEL, TOML, VIEWS, geometry, write_tiny


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("tiny")).parent


def inputs_of(folder, toml):
    (folder / "changed.toml").write_text(toml)
    return find_inputs(read_experiment(folder / "changed.toml"))


class TestTables:
    def test_paths_start_at_the_file(self, tiny):
        experiment = read_experiment(tiny / "experiment.toml")
        assert experiment.output == tiny / "results"
        inputs = find_inputs(experiment)
        assert inputs.reference is not None
        assert len(inputs.reference.files) == VIEWS + 2
        assert inputs.grid.shape == (28, 36, 36)

    def test_stages_take_the_settings_of_the_verbs(self, tiny):
        tables = read_experiment(tiny / "experiment.toml").tables
        assert tables.reconstruct.sweeps == 3
        assert tables.track.search is False
        assert tables.segment.threshold == 0.5

    def test_states_inherit_flats_darks_kind_and_beam(self, tiny):
        states = find_inputs(read_experiment(tiny / "experiment.toml")).states
        for state in states:
            assert state.kind == "counts"
            assert state.geometry.beam == "cone"
            assert state.flats is not None
            assert state.flats.files == (tiny / "flats.tif",)
        np.testing.assert_allclose(states[1].geometry.vectors, geometry([10.0, 55.0, 100.0]).vectors)

    def test_own_kind_needs_no_flats(self, tiny):
        toml = TOML.replace('radiographs = "one.tif"', 'radiographs = "one.tif"\nkind = "transmission"')
        state = inputs_of(tiny, toml).states[0]
        assert (state.kind, state.flats) == ("transmission", None)

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("[volume]", "[volumes]", "volumes: unknown key; did you mean 'volume'?"),
            ("voxel_size", "voxelsize", "volume.voxelsize: unknown key; did you mean 'voxel_size'?"),
            ("sweeps = 3", "sweep = 3", "reconstruct.sweep: unknown key; did you mean 'sweeps'?"),
            ("search = false", "serach = false", "track.serach: unknown key; did you mean 'search'?"),
            ("threshold = 0.5", "treshold = 0.5", "segment.treshold: unknown key; did you mean 'threshold'?"),
            ('geometry = "one.csv"', 'geometri = "one.csv"', "states.one.geometri: unknown key"),
            ("pixel_size = 0.4", "pixelsize = 0.4", "states.two.geometry.pixelsize: unknown key"),
            ('name = "two"', 'naem = "two"', r"states\[2\].naem: unknown key; did you mean 'name'?"),
            ('name = "two"', "", r"states\[2\].name: it is missing"),
            ('name = "two"', 'name = "one"', "'one' is given twice"),
            ('name = "two"', 'name = "report.html"', "cannot be called"),
            ('name = "two"', 'name = "../two"', "states.../two.name"),
            ("sweeps = 3", "sweeps = 0", "reconstruct.sweeps.*got 0"),
            ("sweeps = 3", 'sweeps = "many"', "reconstruct.sweeps.*got 'many'"),
            ("shape = [28, 36, 36]", "shape = [28, 36]", "volume.shape"),
            ("shape = [28, 36, 36]", "shape = [28, 36, 0]", "volume.shape"),
            ("voxel_size = 0.1", "voxel_size = -0.1", "volume.voxel_size.*got -0.1"),
            ("pixel_size = 0.4", "", "states.two.geometry.pixel_size: it is missing"),
            ("pixel_size = 0.4", "pixel_size = 0", "states.two.geometry.pixel_size"),
            ("[10.0, 55.0, 100.0]", '[10.0, "x", 100.0]', r"states.two.geometry.angles_deg\[1\]"),
            ("source_to_axis = 50", "", "states.two.geometry.source_to_axis: it is missing"),
            ("source_to_axis = 50", "source_to_axis = 500", "states.two.geometry.source_to_axis"),
            ('beam = "cone"', 'beam = "fan"', "states.two.geometry.beam"),
            ("angles_deg = [10.0, 55.0, 100.0]", "", "states.two.geometry.angles_deg: it is missing"),
            ('flats = "flats.tif"', "", "reference.flats: it is missing"),
            ('geometry = "one.csv"', "", "states.one.geometry: it is missing"),
            ("[reference]", "[reference", "malformed TOML"),
        ],
    )
    def test_refused(self, tiny, old, new, message):
        assert old in TOML
        with pytest.raises(InputError, match=message):
            inputs_of(tiny, TOML.replace(old, new, 1))

    def test_reference_is_needed(self, tiny):
        with pytest.raises(InputError, match="reference: it is missing"):
            inputs_of(tiny, "[volume]\nvoxel_size = 0.1\n")


CIRCULAR = """
[reference]
radiographs = "all.npy"
kind = "line-integrals"
[reference.geometry]
{beam}
pixel_size = 0.4
{angles}
[[states]]
name = "one"
radiographs = "all.npy"
views = [0, 3]
[states.geometry]
angles_deg = [5, 6, 7, 8]
"""
CONE = "source_to_axis = 50\nsource_to_detector = 200"


class TestCircular:
    @pytest.fixture(autouse=True)
    def images(self, tmp_path):
        np.save(tmp_path / "all.npy", np.ones((4, *PANEL), np.float32))
        (tmp_path / "angles.txt").write_text("# degrees\n0\n30.0\n60 # stage\n\n90\n")

    @pytest.mark.parametrize(
        "angles",
        [
            "angles_deg = [0, 30, 60, 90]",
            'angles_deg = "angles.txt"',
            "angles_deg = { first = 0, last = 90, count = 4 }",
            "first = 0\nlast = 90\ncount = 4",
        ],
    )
    def test_angles(self, tmp_path, angles):
        inputs = inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles=angles))
        assert inputs.reference is not None
        expected = geometry([0, 30, 60, 90]).vectors
        np.testing.assert_allclose(inputs.reference.geometry.vectors, expected)

    def test_state_takes_the_rest_from_the_reference_and_its_views(self, tmp_path):
        inputs = inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4"))
        np.testing.assert_allclose(inputs.states[0].geometry.vectors, geometry([5, 8]).vectors)
        scan, _ = inputs.states[0].read()
        assert len(scan) == 2

    def test_imperfect_set_up(self, tmp_path):
        extra = "detector_offset = [0.3, -0.1]\ndetector_tilts_deg = [1, 2, 3]\naxis_offset = 0.2\n"
        extra += 'axis_tilt_deg = [0.5, 0]\nfirst_row = "top"\nbeam = "parallel"'
        toml = CIRCULAR.format(beam=extra, angles="angles_deg = [0, 30, 60, 90]")
        inputs = inputs_of(tmp_path, toml)
        panel = DetectorAlignment((0.3, -0.1), (1, 2, 3), 0.2, (0.5, 0), "top")
        expected = Geometry.parallel([0, 30, 60, 90], PANEL, 0.4, panel=panel)
        assert inputs.reference is not None
        np.testing.assert_allclose(inputs.reference.geometry.vectors, expected.vectors)
        assert inputs.states[0].geometry.beam == "parallel"

    def test_grid_without_a_table_is_what_the_panel_sees(self, tmp_path):
        grid = inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")).grid
        assert grid.shape == (28, 36, 36)
        assert grid.voxel_size == pytest.approx(0.1)

    @pytest.mark.parametrize(
        ("angles", "message"),
        [
            ("angles_deg = [0, 30, 60]", "3 views, but all.npy .* holds 4 radiographs"),
            ('angles_deg = "none.txt"', "none.txt.*no such file"),
            ("angles_deg = [0, 30, 60, nan]", "reference.geometry.angles_deg"),
        ],
    )
    def test_refused(self, tmp_path, angles, message):
        with pytest.raises(InputError, match=message):
            inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles=angles))

    def test_bad_line_of_angles(self, tmp_path):
        (tmp_path / "angles.txt").write_text("0\n30\nsixty\n90\n")
        with pytest.raises(InputError, match=r"angles\.txt: line 3 is 'sixty'"):
            inputs_of(tmp_path, CIRCULAR.format(beam=CONE, angles='angles_deg = "angles.txt"'))

    def test_geometry_may_hold_the_chosen_views_alone(self, tmp_path):
        toml = CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")
        inputs = inputs_of(tmp_path, toml.replace("[5, 6, 7, 8]", "[5, 8]"))
        np.testing.assert_allclose(inputs.states[0].geometry.vectors, geometry([5, 8]).vectors)
        with pytest.raises(InputError, match=r"3 views, but .* 4 radiographs, of which 2 are chosen"):
            inputs_of(tmp_path, toml.replace("[5, 6, 7, 8]", "[5, 8, 9]"))

    @pytest.mark.parametrize(("views", "count"), [('"::2"', 2), ('"1:"', 3), ("[-1]", 1), ('"2"', 1)])
    def test_views(self, tmp_path, views, count):
        toml = CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")
        state = inputs_of(tmp_path, toml.replace("[0, 3]", views)).states[0]
        assert len(state.geometry) == count

    @pytest.mark.parametrize("views", ['"a:b"', "[9]", '"9"', '"4:"', "[]"])
    def test_views_refused(self, tmp_path, views):
        toml = CIRCULAR.format(beam=CONE, angles="first=0\nlast=90\ncount=4")
        with pytest.raises(InputError, match=r"states\.one\.views"):
            inputs_of(tmp_path, toml.replace("[0, 3]", views))


class TestNXtomo:
    def test_one_file_brings_flats_darks_and_angles(self, tmp_path):
        frames = np.full((7, *PANEL), 1000, np.uint16)
        frames[0], frames[-1] = 10, 2000
        with h5py.File(tmp_path / "scan.nxs", "w") as file:
            file["entry/instrument/detector/data"] = frames
            file["entry/instrument/detector/image_key"] = [2, 0, 0, 0, 0, 0, 1]
            file["entry/sample/rotation_angle"] = [0.0, 0.0, 10.0, 20.0, 30.0, 40.0, 40.0]
        np.save(tmp_path / "later.npy", frames[1:3])
        toml = f"""
[reference]
radiographs = "scan.nxs"
[reference.geometry]
pixel_size = 0.4
{CONE}
[[states]]
name = "one"
radiographs = "scan.nxs"
views = "::2"
[[states]]
name = "two"
radiographs = "later.npy"
geometry = {{ angles_deg = [0, 90] }}
"""
        inputs = inputs_of(tmp_path, toml)
        assert inputs.reference is not None
        expected = geometry([0, 10, 20, 30, 40]).vectors
        np.testing.assert_allclose(inputs.reference.geometry.vectors, expected)
        scan, report = inputs.reference.read()
        np.testing.assert_allclose(scan.line_integrals, -np.log(990 / 1990), rtol=1e-5)
        assert report.bad == 0
        np.testing.assert_allclose(inputs.states[0].geometry.vectors, expected[::2])
        np.testing.assert_allclose(inputs.states[1].read()[0].line_integrals, -np.log(990 / 1990), rtol=1e-5)


class TestPlausible:
    GRID = Volume.zeros((28, 36, 36), 0.1)

    def test_good(self):
        check_plausible("reference", geometry([0, 90]), self.GRID)

    @pytest.mark.parametrize("factor", [1e-3, 1e3])
    def test_units_of_everything_but_the_volume(self, factor):
        views = geometry([0, 90])
        wrong = Geometry(views.vectors * factor, views.shape, "cone")
        with pytest.raises(InputError, match=r"units|unit, mm"):
            check_plausible("reference", wrong, self.GRID)

    @pytest.mark.parametrize("factor", [1e-3, 1e3])
    def test_units_of_the_volume(self, factor):
        with pytest.raises(InputError, match="unit, mm"):
            check_plausible("reference", geometry([0, 90]), Volume.zeros((28, 36, 36), 0.1 * factor))

    @pytest.mark.parametrize(
        "change",
        [
            {"pixel_size": 400.0},
            {"pixel_size": 0.0004},
            {"source_to_axis": 0.05, "source_to_detector": 0.2},
            {"source_to_axis": 0.05},
            {"source_to_detector": 200_000.0},
        ],
    )
    def test_units_of_one_length(self, change):
        lengths = {"pixel_size": 0.4, "source_to_axis": 50.0, "source_to_detector": 200.0, **change}
        with pytest.raises(InputError, match="unit, mm"):
            check_plausible("reference", Geometry.cone([0, 90], PANEL, **lengths), self.GRID)

    def test_panel_that_never_sees_the_sample(self):
        views = geometry([0, 90]).vectors.copy()
        views[1, 3:6] += 60 * views[1, 6:9]
        with pytest.raises(InputError, match=r"states.one.geometry, view 1: the sample never shadows"):
            check_plausible("states.one", Geometry(views, PANEL, "cone"), self.GRID)

    def test_volume_that_is_off_the_panel(self):
        grid = Volume.zeros((28, 36, 36), 0.1, (0.0, 0.0, 100.0))
        with pytest.raises(InputError, match="never shadows"):
            check_plausible("reference", geometry([0, 90]), grid)

    def test_parallel_beam(self):
        check_plausible("reference", Geometry.parallel([0, 90], PANEL, 0.1), self.GRID)
        with pytest.raises(InputError, match="unit, mm"):
            check_plausible("reference", Geometry.parallel([0, 90], PANEL, 100.0), self.GRID)


class TestReadScan:
    """The same scan from Python, without an experiment file."""

    def test_is_the_scan_of_the_experiment(self, tiny):
        scan = read_scan(tiny / "one.tif", tiny / "one.csv", flats=tiny / "flats.tif", darks=tiny / "darks.tif")
        expected, _ = find_inputs(read_experiment(tiny / "experiment.toml")).states[0].read()
        np.testing.assert_array_equal(scan.line_integrals, expected.line_integrals)

    def test_geometry_given_as_such_and_air(self, tiny):
        files = {"flats": [tiny / "flats.tif"], "darks": str(tiny / "darks.tif")}
        scan = read_scan(tiny / "two.npy", geometry([10, 55, 100]), air=Air(margin=2), **files)
        assert abs(np.median(scan.line_integrals[:, :, :2])) < 1e-3

    @pytest.mark.parametrize(
        ("options", "fact"),
        [({}, "flats: it is missing"), ({"geometry": geometry([0, 90]), "kind": "transmission"}, "2 views, but")],
    )
    def test_refused(self, tiny, options, fact):
        with pytest.raises(InputError, match=fact):
            read_scan(tiny / "one.tif", **{"geometry": tiny / "one.csv", **options})
