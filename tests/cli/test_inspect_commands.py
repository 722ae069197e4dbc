"""`grainmotion inspect FILE_OR_FOLDER` and `grainmotion init FOLDER`."""

import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.experiment.config import read_experiment
from grainmotion.io.tiff import write_tiff
from grainmotion.io.volumes.access import write_labels, write_volume
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from lab_scanner import Lab
from nxtomo_writer import write_nxtomo
from tiny_experiment import write_tiny

XTEKCT = """[XTekCT]
Name={name}
InputSeparator=_
SrcToObject=100
SrcToDetector=400
DetectorPixelsX=32
DetectorPixelSizeX=0.2
DetectorPixelsY=24
DetectorPixelSizeY=0.2
Projections={count}
InitialAngle=0
AngularStep={step}
WhiteLevel=60000
ObjectOffsetX=0
ObjectTilt=0
ObjectRoll=0
DetectorOffsetX=0
DetectorOffsetY=0
"""


def nikon_scan(folder, count, step):
    """A folder of a Nikon scanner, named as its scan."""
    folder.mkdir(parents=True)
    for k in range(1, count + 1):
        write_tiff(folder / f"{folder.name}_{k:04d}.tif", np.full((24, 32), 50_000, np.uint16))
    text = XTEKCT.format(name=folder.name, count=count, step=step)
    (folder / f"{folder.name}.xtekct").write_text(text, encoding="cp1252")


def write_data_exchange(path, lines, angles):
    """A Data Exchange file of a parallel beam, which does not tell where row 0 lies."""
    with h5py.File(path, "w") as file:
        file["exchange/data"] = np.round(40_000 * np.exp(-lines)).astype(np.uint16)
        file["exchange/data_white"] = np.full((2, *lines.shape[1:]), 40_000, np.uint16)
        file["exchange/theta"] = angles
        file["exchange/theta"].attrs["units"] = "degrees"
        size = file.create_dataset("measurement/instrument/detector/actual_pixel_size_x", data=100.0)
        size.attrs["units"] = "microns"


def rx_scan(folder):
    """A folder of RX Solutions with its table of views; its XML."""
    (folder / "Proj").mkdir()
    lab, rows = Lab(), ["Geometry", "Image"]
    for k in range(12):
        a = np.deg2rad(30 * k)
        forward, right = np.array([np.cos(a), 0, np.sin(a)]), np.array([-np.sin(a), 0, np.cos(a)])  # X Y Z, Y up
        points = [-60 * forward, 180 * forward, 180 * forward + [0, 11.2, 0], 180 * forward + 12.8 * right]
        rows.append(f"p_{k}.tif;" + ";".join(f"{x:.6f}" for x in np.concatenate(points)))
        write_tiff(folder / f"Proj/p_{k}.tif", np.round(60_000 * np.exp(-lab.image(-30 * k))).astype(np.uint16))
    (folder / "geom.csv").write_text("\n".join(rows) + "\n")
    return folder / "geom.csv"


def invoke(*arguments, code=0):
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("tiny")).parent


class TestInspect:
    def test_a_folder_with_tables_of_views_is_described_and_drawn(self, tiny, tmp_path):
        folder = shutil.copytree(tiny, tmp_path / "copy")
        (folder / "experiment.toml").unlink()
        text = invoke("inspect", folder, "--terminal").stdout
        assert "grainmotion init" in text
        assert "row 0 is the lowest row" in text
        assert (folder / "inspection.png").exists()
        assert "z up" in text

    def test_a_scanners_file_tells_what_it_lacks(self, tmp_path):
        lab, angles = Lab(), np.arange(0, 360, 30.0)
        write_nxtomo(tmp_path / "scan.nxs", lab.images(-angles), angles)
        text = invoke("inspect", tmp_path / "scan.nxs").stdout
        assert "NXtomo" in text
        assert "12 from 0 to 330 degrees" in text
        assert "to be given in the experiment file" in text

    def test_a_file_that_lacks_only_the_first_row_is_drawn_all_the_same(self, tmp_path):
        write_data_exchange(tmp_path / "scan.h5", Lab().images(np.arange(0, 180, 15.0)), np.arange(0, 180, 15.0))
        text = invoke("inspect", tmp_path / "scan.h5").stdout
        assert 'drawn with first_row = "top"' in text
        assert "the highest row, assumed" in text
        assert "to be given in the experiment file: reference.geometry.first_row" in text
        assert (tmp_path / "inspection.png").exists()

    def test_a_file_without_the_open_beam_is_drawn_all_the_same(self, tmp_path):
        """RX Solutions: all of the geometry is told, but neither flats nor the white level."""
        path = rx_scan(tmp_path)
        text = invoke("inspect", path).stdout
        assert "Source to axis, to panel  60 mm, 240 mm" in text.replace("          ", "  ").replace("    ", "")
        assert "drawn with an open beam of 60000 counts" in text
        assert "to be given in the experiment file: reference.flats: it is missing" in text
        assert (tmp_path / "inspection.png").exists()

    def test_a_damaged_radiograph_is_an_error(self, tmp_path):
        nikon_scan(tmp_path / "full", 12, 30)
        image = tmp_path / "full/full_0001.tif"
        tifffile.imwrite(image, np.full((24, 32), 50_000, np.uint16))  # its header before its pixels
        image.write_bytes(image.read_bytes()[: image.stat().st_size // 2])
        result = invoke("inspect", tmp_path / "full/full.xtekct", code=2)
        assert "Nikon .xtekct" in result.stdout
        assert "error: " in result.stderr
        assert "truncated or damaged TIFF" in result.stderr
        assert "not usable: " in invoke("inspect", tmp_path / "full").stdout

    def test_files_of_two_images_each_are_an_error(self, tmp_path):
        nikon_scan(tmp_path / "full", 12, 30)
        for image in (tmp_path / "full").glob("*.tif"):
            write_tiff(image, np.full((2, 24, 32), 50_000, np.uint16))
        result = invoke("inspect", tmp_path / "full/full.xtekct", code=2)
        assert "12 views, but" in result.stderr
        assert "holds 24 radiographs" in result.stderr

    @pytest.mark.parametrize("suffix", [".npy", ".geom"])
    def test_vectors_of_views_are_described(self, tmp_path, suffix):
        views = Geometry.cone(np.arange(40) * 9.0, (6, 8), 0.4, source_to_axis=50.0, source_to_detector=200.0).vectors
        path = tmp_path / f"views{suffix}"
        np.save(path, views) if suffix == ".npy" else np.savetxt(path, views)
        text = invoke("inspect", path).stdout
        assert "40 positions of source and panel" in text
        assert "40 from 0 to 351 degrees in steps of 9" in text

    def test_the_geometry_of_rtk_is_described(self):
        text = invoke("inspect", Path(__file__).parents[1] / "io/rtk_data/cone.xml").stdout
        assert "positions of source and panel" in text

    def test_an_image_is_described(self, tmp_path):
        write_tiff(tmp_path / "a.tif", np.full((2, 20, 30), 5000, np.uint16))
        assert "2 x 20 x 30" in invoke("inspect", tmp_path / "a.tif").stdout

    def test_volumes_are_described_with_their_voxel_size(self, tmp_path):
        volume = Volume(np.ones((4, 5, 6), np.float32), 0.0125)
        write_volume(tmp_path / "a.zarr", volume)
        write_volume(tmp_path / "b.tif", volume)
        write_labels(tmp_path / "c.zarr", np.arange(120).reshape(4, 5, 6), volume)
        text = invoke("inspect", tmp_path / "a.zarr").stdout
        assert "4 x 5 x 6 voxels (z, y, x) float32" in text
        assert "0.0125 mm by its the scale" not in text
        assert "0.0125 mm by its" in text
        assert "0.0125 mm by its ImageJ properties" in invoke("inspect", tmp_path / "b.tif").stdout
        assert "60 to 89 in the middle slice, 30 different" in invoke("inspect", tmp_path / "c.zarr").stdout
        np.ones((4, 5, 6), np.uint16).tofile(tmp_path / "d.raw")
        assert "d.raw::uint16" in invoke("inspect", tmp_path / "d.raw", code=2).stderr

    def test_folders_without_measurements_and_missing_files_are_refused(self, tmp_path):
        assert "no scan and no images" in invoke("inspect", tmp_path, code=2).stderr
        error = invoke("inspect", tmp_path / "none.xtekct", code=2).stderr
        assert f"no such file or folder; check the name; the folder {tmp_path} holds" in error
        assert "check the path" in invoke("inspect", tmp_path / "no" / "none.tif", code=2).stderr

    def test_a_mistyped_name_is_told(self, tmp_path):
        (tmp_path / "measurements").mkdir()
        error = invoke("inspect", tmp_path / "mesurements", code=2).stderr
        assert f"did you mean grainmotion inspect {tmp_path / 'measurements'}?" in error

    @pytest.mark.skipif(os.name != "posix", reason="a named pipe is made")
    def test_a_pipe_is_told_from_a_missing_file(self, tmp_path):
        os.mkfifo(tmp_path / "pipe.tif")
        error = invoke("inspect", tmp_path / "pipe.tif", code=2).stderr
        assert "it is a device or a pipe, and no file; name a file on a disk" in error

    def test_results_in_a_folder_are_named(self, tiny, tmp_path):
        folder = shutil.copytree(tiny, tmp_path / "copy")
        for name, file in (("results", "report.html"), ("half", "run.log")):
            (folder / name).mkdir()
            (folder / name / "stages.json").write_text("{}")
            (folder / name / file).touch()
        lines = invoke("inspect", folder).stdout.splitlines()
        assert f"results: {folder / 'results' / 'report.html'}" in lines
        assert f"results: {folder / 'half'}" in lines  # without a report
        assert lines[-1] == f"next: grainmotion inspect {folder / 'experiment.toml'}"


class TestInit:
    def test_writes_a_file_that_can_be_run(self, tiny, tmp_path):
        folder = shutil.copytree(tiny, tmp_path / "copy")
        (folder / "experiment.toml").unlink()
        text = invoke("init", folder).stdout
        assert f"experiment: {folder / 'experiment.toml'}" in text
        tables = read_experiment(folder / "experiment.toml").tables
        assert tables.reference.flats is not None

    def test_keys_that_a_scanners_file_lacks_are_to_be_filled_in(self, tmp_path):
        lines = Lab().images(np.arange(0, 180, 15.0))
        write_data_exchange(tmp_path / "full.h5", lines, np.arange(0, 180, 15.0))
        write_data_exchange(tmp_path / "later.h5", lines[:3], np.arange(0, 45, 15.0))
        text = invoke("init", tmp_path).stdout
        assert "to fill in: [reference.geometry]: first_row, in the lines with TODO" in text
        path = tmp_path / "experiment.toml"
        written = path.read_text()
        assert '\n# first_row = "top"              # TODO' in written
        path.write_text(written.replace("# first_row", "first_row"))
        invoke("inspect", path)  # complete once the line is in force

    def test_an_experiment_is_not_overwritten(self, tiny, tmp_path):
        folder = shutil.copytree(tiny, tmp_path / "copy")
        assert "--force" in invoke("init", folder, code=2).stderr
        assert invoke("init", folder, "--force").stdout

    def test_a_folder_that_is_none_is_refused(self, tmp_path):
        assert "it is no folder" in invoke("init", tmp_path / "none", code=2).stderr


class TestARelativePath:
    """Paths as they are typed: images are looked up from the scanner's file, not from there once more."""

    @pytest.mark.parametrize("name", ["scan ä [1]", "."])
    def test_of_a_scanners_folder_and_file(self, tmp_path, monkeypatch, name):
        nikon_scan(tmp_path / name / "full", 12, 30)
        nikon_scan(tmp_path / name / "begin", 4, 45)
        monkeypatch.chdir(tmp_path)
        for target in (name, f"{name}/full/full.xtekct"):
            text = invoke("inspect", target).stdout
            assert "12 of 24 x 32 pixels" in text
            assert "to be given" not in text
            assert "full: row 0 is the highest row" in text  # the largest scan is drawn
            if target == name:
                line = "begin.xtekct: Nikon .xtekct, 4 of 24 x 32 pixels, 4 from 0 to 135 degrees in steps of 45"
                assert f"scan: begin/{line}" in text  # and the other in one line
        assert "experiment: " in invoke("init", name).stdout
        tables = read_experiment(tmp_path / name / "experiment.toml").tables
        assert tables.reference.radiographs == ["full/full.xtekct"]
        assert [state.name for state in tables.states] == ["begin"]  # and not the picture that inspect drew
