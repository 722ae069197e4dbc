"""Scans read from files: NXtomo files, which include flats, darks and angles, and `read_scan`."""

import dataclasses
import inspect

import h5py
import numpy as np
import pytest
from experiment_inputs import inputs_of

from grainmotion.errors import InputError, InputWarning
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.scan_files import read_scan
from grainmotion.experiment.scan_tables import Air, ScanSettings, ScanTable
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.finding import Level
from tiny_experiment import PANEL, geometry, write_tiny

CONE = "source_to_axis = 50\nsource_to_detector = 200"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("tiny")).parent


class TestNXtomo:
    def test_one_file_provides_flats_darks_and_angles(self, tmp_path):
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
first_row = "bottom"
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


class TestReadScan:
    """Reading a scan from Python, without an experiment file."""

    def test_equals_the_scan_of_the_experiment(self, tiny):
        scan = read_scan(tiny / "one.tif", tiny / "one.csv", flats=tiny / "flats.tif", darks=tiny / "darks.tif")
        expected, _ = find_inputs(read_experiment(tiny / "experiment.toml")).states[0].read()
        np.testing.assert_array_equal(scan.line_integrals, expected.line_integrals)

    def test_geometry_object_and_air_correction(self, tiny):
        files = {"flats": [tiny / "flats.tif"], "darks": str(tiny / "darks.tif")}
        scan = read_scan(tiny / "two.npy", geometry([10, 55, 100]), ScanSettings(air=Air(margin=2)), **files)
        assert abs(np.median(scan.line_integrals[:, :, :2])) < 1e-3

    @pytest.mark.parametrize(
        ("options", "fact"),
        [
            ({}, "flats: it is missing"),
            ({"geometry": geometry([0, 90]), "kind": "transmission"}, "2 views, but"),
            ({"kind": "photons"}, "kind: input should be 'counts', .* got 'photons'"),
        ],
    )
    def test_bad_options_are_refused(self, tiny, options, fact):
        with pytest.raises(InputError, match=fact):
            read_scan(tiny / "one.tif", **{"geometry": tiny / "one.csv", **options})

    def test_arguments_and_settings_are_the_keys_of_a_scans_table(self):
        given = {field.name for field in dataclasses.fields(ScanSettings)}
        arguments = set(inspect.signature(read_scan).parameters) - {"settings"}
        assert given | arguments == set(ScanTable.model_fields)
        assert not given & arguments

    @pytest.mark.parametrize("views", ["::2", [0, 2], np.array([0, 2]), range(0, 3, 2)])
    def test_views_may_be_chosen(self, tiny, views):
        files = {"flats": tiny / "flats.tif", "darks": tiny / "darks.tif"}
        whole = read_scan(tiny / "two.npy", geometry([10, 55, 100]), **files)
        some = read_scan(tiny / "two.npy", geometry([10, 55, 100]), ScanSettings(views=views), **files)
        np.testing.assert_array_equal(some.line_integrals, whole.line_integrals[::2])
        np.testing.assert_allclose(some.geometry.azimuths_deg, [10, 100])

    def test_a_white_level_stands_for_flats_and_saturated_pixels_are_masked(self, tmp_path):
        counts = np.random.default_rng(0).poisson(500.0, (2, *PANEL)).astype(float)
        counts[0, 1, 2] = 1600
        np.save(tmp_path / "state.npy", counts)
        scan = read_scan(tmp_path / "state.npy", geometry([0, 90]), ScanSettings(white_level=1000, saturation=1500))
        assert not scan.valid[0, 1, 2]
        assert np.median(scan.line_integrals) == pytest.approx(np.log(2), abs=0.01)

    def test_bad_settings_are_refused(self, tiny):
        with pytest.raises(InputError, match=r"ScanSettings.saturation: .* greater than 0"):
            ScanSettings(saturation=0)
        with pytest.raises(InputError, match=r"read_scan\(settings\): got dict, wants ScanSettings"):
            read_scan(tiny / "one.tif", tiny / "one.csv", {"views": "::2"})

    def test_bad_air_margin_is_refused(self):
        with pytest.raises(InputError, match=r"Air\.margin: .* greater than 0, got 0"):
            Air(margin=0)


CIRCLE = f"""
[reference]
radiographs = {{radiographs}}
kind = "line-integrals"
[reference.geometry]
pixel_size = 0.4
first_row = "bottom"
angles_deg = {{angles}}
{CONE}
"""


class TestFilesAndAngles:
    """What names of files and told angles say, as findings of a scan or as the cause in an error."""

    @pytest.fixture
    def series(self, tmp_path):
        for k in range(12):
            write_tiff(tmp_path / f"proj_{k:04d}.tif", np.ones(PANEL, np.float32))
        return tmp_path

    def scan(self, folder, angles, radiographs='"*.tif"'):
        reference = inputs_of(folder, CIRCLE.format(radiographs=radiographs, angles=angles)).reference
        assert reference is not None
        return reference

    @pytest.mark.parametrize("radiographs", ['"*.tif"', '"."', '"proj_????.TIF"'])
    def test_good_series(self, series, radiographs):
        found = self.scan(series, "{ first = 0, last = 330, count = 12 }", radiographs).findings
        assert [f.level for f in found if f.level is not Level.NOTE] == []

    def test_gap_in_the_series_is_a_warning(self, series):
        (series / "proj_0007.tif").unlink()
        (finding,) = self.scan(series, "{ first = 0, last = 330, count = 11 }").findings
        assert finding.level is Level.WARNING
        assert finding.where == "reference.radiographs"
        assert "proj_0007.tif is not there" in finding.fact

    def test_errors_of_several_scans_are_told_at_once(self, series):
        toml = CIRCLE.format(radiographs='"*.tif"', angles="[0, 30]")
        for name in ("one", "two"):
            toml += f'[[states]]\nname = "{name}"\nradiographs = "{name}*.tif"\ngeometry = {{ angles_deg = [0, 90] }}\n'
        with pytest.raises(InputError) as error:
            inputs_of(series, toml)
        first, second, third = str(error.value).splitlines()
        assert "reference.geometry: 2 views, but *.tif" in first
        assert "one*.tif (states.one.radiographs): no file matches" in second
        assert "two*.tif (states.two.radiographs): no file matches" in third

    @pytest.mark.parametrize("dtype", [np.float16, np.float64, np.int16, np.int32, np.uint8])
    def test_types_of_counts(self, tmp_path, dtype):
        for name, count in (("scan", 50), ("flat", 100)):
            np.save(tmp_path / f"{name}.npy", np.full((3, *PANEL), count, dtype))
        views = geometry([0, 30, 60])
        scan = read_scan(tmp_path / "scan.npy", views, flats=tmp_path / "flat.npy")
        np.testing.assert_allclose(scan.line_integrals, np.log(2), rtol=1e-5)

    @pytest.mark.parametrize(("flats", "count"), [(np.uint16, 1), (np.uint8, 0), (np.float32, 0)])
    def test_radiographs_of_8_bits_beside_flats_of_16_are_named(self, series, flats, count):
        for path in series.glob("proj_*.tif"):
            write_tiff(path, np.full(PANEL, 50, np.uint8))
        write_tiff(series / "flat.tif", np.full(PANEL, 200, flats))
        toml = CIRCLE.format(radiographs='"proj_*.tif"', angles="{ first = 0, last = 330, count = 12 }")
        reference = inputs_of(series, toml.replace('kind = "line-integrals"', 'flats = "flat.tif"')).reference
        assert reference is not None
        assert ["one of them is probably scaled" in f.fact for f in reference.findings] == [True] * count

    def test_gap_is_the_cause_of_too_few_files(self, series):
        (series / "proj_0007.tif").unlink()
        with pytest.raises(InputError, match=r"holds 11 radiographs \(missing in the series: proj_0007.tif\)"):
            self.scan(series, "{ first = 0, last = 330, count = 12 }")

    def test_radians_are_an_error_until_they_are_fixed(self, series):
        angles = str(np.radians(np.arange(12) * 30.0).tolist())
        (finding,) = self.scan(series, angles).findings
        assert (finding.level, finding.fix) == (Level.ERROR, "angles-in-radians")
        toml = CIRCLE.format(radiographs='"*.tif"', angles=angles)
        fixed = inputs_of(series, toml.replace("kind", f'fixes = ["{finding.fix}"]\nkind', 1)).reference
        assert fixed is not None
        assert fixed.findings == ()
        np.testing.assert_allclose(fixed.geometry.vectors, geometry(np.arange(12) * 30.0).vectors, atol=1e-9)

    def test_angles_from_hdf5(self, series):
        with h5py.File(series / "scan.h5", "w") as file:
            file["exchange/theta"] = np.radians(np.arange(12) * 30.0)
            file["exchange/theta"].attrs["units"] = "rad"
        scan = self.scan(series, '"scan.h5::/exchange/theta"')
        np.testing.assert_allclose(scan.geometry.vectors, geometry(np.arange(12) * 30.0).vectors, atol=1e-9)
        assert scan.findings == ()


class TestPixelsOfSomeViews:
    def test_are_masked_as_in_the_whole_scan(self, tmp_path):
        path = write_tiny(tmp_path)
        for file in (tmp_path / "reference").iterdir():
            image = read_tiff(file)
            image[:, 9, 12] = 7_000  # stuck: one value in all views
            write_tiff(file, image)
        source = find_inputs(read_experiment(path)).reference
        whole, report = source.read()
        assert report.stuck == 40
        for views in (np.array([3]), np.array([38, 2, 21]), np.arange(10, 30)):
            some, _ = source.select(views).read()
            twice, _ = source.select(np.arange(39, -1, -1)).select(39 - views).read()
            for scan in (some, twice):
                np.testing.assert_array_equal(scan.line_integrals, whole.line_integrals[views])
                np.testing.assert_array_equal(scan.valid, whole.valid[views])


class TestWarningsOfReadScan:
    def test_flats_of_which_one_is_empty(self, tmp_path):
        write_tiny(tmp_path)
        flats = read_tiff(tmp_path / "flats.tif")
        flats[1] = 0
        write_tiff(tmp_path / "flats.tif", flats)
        with pytest.warns(InputWarning, match=r"flats.tif \(scan.flats\): 1 of 3 flats left out of the mean"):
            scan = read_scan(tmp_path / "one.tif", tmp_path / "one.csv", flats=tmp_path / "flats.tif")
        assert scan.valid is None

    def test_transmissions_without_flats(self, tmp_path):
        write_tiny(tmp_path)
        images = read_tiff(tmp_path / "one.tif") / np.float32(50_100)
        write_tiff(tmp_path / "one.tif", images)
        with pytest.raises(InputError, match=r'looks like transmission, not counts; set scan.kind = "transmission"'):
            read_scan(tmp_path / "one.tif", tmp_path / "one.csv")
