"""Bad input of the commands: one line naming file or key and a remedy, exit code 2, no file changed, no traceback."""

import hashlib
import subprocess
import sys

import h5py
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.io.tiff import read_tiff, write_tiff
from tiny_experiment import PANEL, write_tiny

OLD_RESULTS = ("reference.h5", "report.html", "one/motions.csv", "one/motions.h5", "one/residuals.tif")


@pytest.fixture
def tiny(tmp_path):
    """The tiny experiment with results of an earlier run, which must not change."""
    write_tiny(tmp_path)
    for name in OLD_RESULTS:
        path = tmp_path / "results" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"precious {name}")
    return tmp_path


def digests(folder):
    """SHA-256 of every file in the folder."""
    return {p.relative_to(folder): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*") if p.is_file()}


def replace_text(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def truncate(path, share):
    """Keep only the first share of the file's bytes."""
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])


def set_pixel(path, value, index=(0, 3, 4), dtype=np.float32):
    images = read_tiff(path).astype(dtype)
    images[index] = value
    write_tiff(path, images)


def set_row(path, row, **values):
    table = pd.read_csv(path)
    for name, value in values.items():
        table.loc[row, name] = value
    table.to_csv(path, index=False)


def make_u_and_v_parallel(path):
    table = pd.read_csv(path)
    table[["vx", "vy", "vz"]] = 2 * table[["ux", "uy", "uz"]]
    table.to_csv(path, index=False)


def move_detector_away(path):
    table = pd.read_csv(path)
    table.loc[1, "dz"] += 500
    table.to_csv(path, index=False)


def multiply_by_thousand(path):
    (pd.read_csv(path) * 1000).to_csv(path, index=False)


def truncated_hdf5(folder, share):
    images = read_tiff(folder / "one.tif")
    with h5py.File(folder / "one.h5", "w") as file:
        file["images"] = images
    replace_text(folder / "experiment.toml", '"one.tif"', '"one.h5::/images"')
    truncate(folder / "one.h5", share)


def truncated_npy(folder, share):
    np.save(folder / "one.npy", read_tiff(folder / "one.tif"))
    replace_text(folder / "experiment.toml", '"one.tif"', '"one.npy"')
    truncate(folder / "one.npy", share)


def swap_flats_and_darks(folder):
    flats, darks = read_tiff(folder / "flats.tif"), read_tiff(folder / "darks.tif")
    write_tiff(folder / "flats.tif", darks)
    write_tiff(folder / "darks.tif", flats)


def edit_toml(old, new):
    return lambda f: replace_text(f / "experiment.toml", old, new)


MANY = (0, slice(0, 10))  # rows of the first image, more than a tenth of its pixels
CASES = {
    "missing experiment file": (lambda f: (f / "experiment.toml").unlink(), "experiment.toml"),
    "empty experiment file": (lambda f: (f / "experiment.toml").write_text(""), "experiment.toml"),
    "malformed TOML": (edit_toml("[volume]", "[volume"), "experiment.toml"),
    "missing radiographs": (lambda f: (f / "one.tif").unlink(), "one.tif"),
    "no radiograph matches": (edit_toml("reference/*.tif", "reference/*.tiff"), "reference.radiographs"),
    "empty radiograph": (lambda f: (f / "reference" / "7.tif").write_bytes(b""), "7.tif"),
    "missing flats": (lambda f: (f / "flats.tif").unlink(), "flats.tif"),
    "missing geometry": (lambda f: (f / "one.csv").unlink(), "one.csv"),
    "empty geometry": (lambda f: (f / "one.csv").write_text(""), "one.csv"),
    "too few views": (lambda f: (f / "reference" / "39.tif").unlink(), "reference.csv"),
    "too many angles": (edit_toml("100.0]", "100.0, 145.0]"), "states.two"),
    "radiographs of two sizes": (lambda f: write_tiff(f / "reference" / "7.tif", np.ones((2, 5), np.uint16)), "7.tif"),
    "flats of another size": (lambda f: write_tiff(f / "flats.tif", np.ones((2, 8, 8), np.uint16)), "flats.tif"),
    "geometry without a column": (lambda f: replace_text(f / "one.csv", "uy", "yu"), "one.csv"),
    "geometry row with NaN": (lambda f: set_row(f / "one.csv", 1, sx=np.nan), "row 2"),
    "zero-length u": (lambda f: set_row(f / "one.csv", 2, ux=0, uy=0, uz=0), "row 3"),
    "zero-length v": (lambda f: set_row(f / "one.csv", 2, vx=0, vy=0, vz=0), "row 3"),
    "parallel u and v": (lambda f: make_u_and_v_parallel(f / "one.csv"), "one.csv"),
    "panel never shadowed": (lambda f: move_detector_away(f / "one.csv"), "states.one.geometry, view 1"),
    "unknown key": (edit_toml("sweeps", "sweep"), "did you mean 'sweeps'"),
    "unknown table": (edit_toml("[track]", "[tracking]"), "did you mean 'track'"),
    "unknown key in a state": (edit_toml('name = "two"', 'name = "two"\nflat = "a.tif"'), "did you mean 'flats'"),
    "wrong type of a value": (edit_toml("sweeps = 3", 'sweeps = "three"'), "reconstruct.sweeps"),
    "voxels in µm": (edit_toml("voxel_size = 0.1", "voxel_size = 100"), "volume.voxel_size"),
    "voxels in m": (edit_toml("voxel_size = 0.1", "voxel_size = 0.0001"), "volume.voxel_size"),
    "geometry in µm": (lambda f: multiply_by_thousand(f / "reference.csv"), "reference.geometry"),
    "pixels in µm": (edit_toml("pixel_size = 0.4", "pixel_size = 400"), "states.two.geometry"),
    "distances in m": (edit_toml("source_to_axis = 50", "source_to_axis = 0.05"), "states.two.geometry"),
    "NaN counts in the reference": (lambda f: set_pixel(f / "reference" / "7.tif", np.nan, MANY), "reference.radio"),
    "NaN counts in a state": (lambda f: set_pixel(f / "one.tif", np.nan, MANY), "one.tif"),
    "negative counts": (lambda f: set_pixel(f / "one.tif", -5), "one.tif"),
    "flats below darks": (swap_flats_and_darks, "flats.tif"),
    "NaN in the flats": (lambda f: set_pixel(f / "flats.tif", np.nan, MANY), "flats.tif"),
    "truncated TIFF": (lambda f: truncate(f / "one.tif", 0.6), "one.tif"),
    "truncated TIFF header": (lambda f: truncate(f / "reference" / "7.tif", 0.02), "7.tif"),
    "truncated HDF5": (lambda f: truncated_hdf5(f, 0.6), "one.h5"),
    "empty HDF5": (lambda f: truncated_hdf5(f, 0.0), "one.h5"),
    "truncated npy": (lambda f: truncated_npy(f, 0.6), "one.npy"),
    "no TIFF at all": (lambda f: (f / "one.tif").write_text("hello, this is text"), "one.tif"),
    "air outside the panel": (edit_toml("[volume]", "air = { margin = 90 }\n[volume]"), "reference.air.margin"),
    "missing start": (edit_toml('name = "two"', 'name = "two"\ninitial = "start.csv"'), "start.csv"),
}  # fmt: skip


def assert_one_line(result_stderr, code, named):
    """After the progress one line tells what is wrong."""
    *progress, line = result_stderr.strip().splitlines()
    assert code == 2, result_stderr
    assert not [other for other in progress if other.startswith("error: ")], result_stderr
    assert line.startswith("error: ")
    assert named in line
    assert "; " in line
    assert "Traceback" not in result_stderr


@pytest.mark.parametrize("case", CASES)
def test_run_refuses_bad_input(tiny, case):
    make_bad, named = CASES[case]
    make_bad(tiny)
    before = digests(tiny)
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, named)
    assert digests(tiny) == before


@pytest.mark.parametrize("threshold", ["50.0", "2.9"])
def test_threshold_without_grains_is_refused(tiny, threshold):
    replace_text(tiny / "experiment.toml", "threshold = 0.5", f"threshold = {threshold}")
    before = digests(tiny)
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, "no grains")
    after = digests(tiny)
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize("noise", [0, 300])
def test_radiographs_of_the_empty_beam_are_refused(tiny, noise):
    rng = np.random.default_rng(0)
    for path in (tiny / "reference").iterdir():
        write_tiff(path, rng.normal(50_000, noise, PANEL).astype(np.uint16))
    replace_text(tiny / "experiment.toml", "threshold = 0.5", "")
    before = digests(tiny)
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, "no grains found")
    assert digests(tiny) == before


@pytest.mark.parametrize("command", ["reconstruct", "segment", "track", "report", "inspect"])
def test_every_command_refuses_a_truncated_radiograph(tiny, command):
    truncate(tiny / "one.tif", 0.6)
    before = digests(tiny)
    result = CliRunner().invoke(app, [command, str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, "one.tif")
    assert digests(tiny) == before


def test_missing_radiographs_in_a_separate_process(tiny):
    (tiny / "one.tif").unlink()
    done = subprocess.run(
        [sys.executable, "-c", "from grainmotion.__main__ import main; main()", "run", str(tiny / "experiment.toml")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert_one_line(done.stderr, done.returncode, "one.tif")


def test_results_folder_that_is_a_file_is_refused(tiny):
    (tiny / "out").write_text("precious")
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml"), "--out", str(tiny / "out")])
    assert_one_line(result.stderr, result.exit_code, "out")
    assert (tiny / "out").read_text() == "precious"
