"""Bad input: one line that names file or key and a remedy, exit code 2, nothing overwritten, no traceback."""

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
    """The tiny experiment with results of an earlier run that must survive."""
    write_tiny(tmp_path)
    for name in OLD_RESULTS:
        path = tmp_path / "results" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"precious {name}")
    return tmp_path


def prints(folder):
    return {p.relative_to(folder): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*") if p.is_file()}


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def cut(path, share):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])


def change_image(path, value, place=(0, 3, 4), dtype=np.float32):
    images = read_tiff(path).astype(dtype)
    images[place] = value
    write_tiff(path, images)


def change_table(path, row, **values):
    table = pd.read_csv(path)
    for name, value in values.items():
        table.loc[row, name] = value
    table.to_csv(path, index=False)


def parallel_steps(path):
    table = pd.read_csv(path)
    table[["vx", "vy", "vz"]] = 2 * table[["ux", "uy", "uz"]]
    table.to_csv(path, index=False)


def moved_panel(path):
    table = pd.read_csv(path)
    table.loc[1, "dz"] += 500
    table.to_csv(path, index=False)


def times_thousand(path):
    (pd.read_csv(path) * 1000).to_csv(path, index=False)


def as_hdf5(folder, share):
    images = read_tiff(folder / "one.tif")
    with h5py.File(folder / "one.h5", "w") as file:
        file["images"] = images
    change(folder / "experiment.toml", '"one.tif"', '"one.h5::/images"')
    cut(folder / "one.h5", share)


def as_npy(folder, share):
    np.save(folder / "one.npy", read_tiff(folder / "one.tif"))
    change(folder / "experiment.toml", '"one.tif"', '"one.npy"')
    cut(folder / "one.npy", share)


def swapped(folder):
    flats, darks = read_tiff(folder / "flats.tif"), read_tiff(folder / "darks.tif")
    write_tiff(folder / "flats.tif", darks)
    write_tiff(folder / "darks.tif", flats)


def toml(old, new):
    return lambda f: change(f / "experiment.toml", old, new)


CASES = {
    "missing experiment file": (lambda f: (f / "experiment.toml").unlink(), "experiment.toml"),
    "empty experiment file": (lambda f: (f / "experiment.toml").write_text(""), "experiment.toml"),
    "malformed TOML": (toml("[volume]", "[volume"), "experiment.toml"),
    "missing radiographs": (lambda f: (f / "one.tif").unlink(), "one.tif"),
    "no radiograph matches": (toml("reference/*.tif", "reference/*.tiff"), "reference.radiographs"),
    "empty radiograph": (lambda f: (f / "reference" / "7.tif").write_bytes(b""), "7.tif"),
    "missing flats": (lambda f: (f / "flats.tif").unlink(), "flats.tif"),
    "missing geometry": (lambda f: (f / "one.csv").unlink(), "one.csv"),
    "empty geometry": (lambda f: (f / "one.csv").write_text(""), "one.csv"),
    "too few views": (lambda f: (f / "reference" / "39.tif").unlink(), "reference.csv"),
    "too many angles": (toml("100.0]", "100.0, 145.0]"), "states.two"),
    "radiographs of two sizes": (lambda f: write_tiff(f / "reference" / "7.tif", np.ones((2, 5), np.uint16)), "7.tif"),
    "flats of another size": (lambda f: write_tiff(f / "flats.tif", np.ones((2, 8, 8), np.uint16)), "flats.tif"),
    "geometry without a column": (lambda f: change(f / "one.csv", "uy", "yu"), "one.csv"),
    "geometry row with NaN": (lambda f: change_table(f / "one.csv", 1, sx=np.nan), "row 2"),
    "zero-length u": (lambda f: change_table(f / "one.csv", 2, ux=0, uy=0, uz=0), "row 3"),
    "zero-length v": (lambda f: change_table(f / "one.csv", 2, vx=0, vy=0, vz=0), "row 3"),
    "parallel u and v": (lambda f: parallel_steps(f / "one.csv"), "one.csv"),
    "panel never shadowed": (lambda f: moved_panel(f / "one.csv"), "states.one.geometry, view 1"),
    "unknown key": (toml("sweeps", "sweep"), "did you mean 'sweeps'"),
    "unknown table": (toml("[track]", "[tracking]"), "did you mean 'track'"),
    "unknown key in a state": (toml('name = "two"', 'name = "two"\nflat = "a.tif"'), "did you mean 'flats'"),
    "wrong type of a value": (toml("sweeps = 3", 'sweeps = "three"'), "reconstruct.sweeps"),
    "voxels in µm": (toml("voxel_size = 0.1", "voxel_size = 100"), "volume.voxel_size"),
    "voxels in m": (toml("voxel_size = 0.1", "voxel_size = 0.0001"), "volume.voxel_size"),
    "geometry in µm": (lambda f: times_thousand(f / "reference.csv"), "reference.geometry"),
    "pixels in µm": (toml("pixel_size = 0.4", "pixel_size = 400"), "states.two.geometry"),
    "distances in m": (toml("source_to_axis = 50", "source_to_axis = 0.05"), "states.two.geometry"),
    "NaN counts in the reference": (lambda f: change_image(f / "reference" / "7.tif", np.nan), "reference.radiographs"),
    "NaN counts in a state": (lambda f: change_image(f / "one.tif", np.nan), "one.tif"),
    "negative counts": (lambda f: change_image(f / "one.tif", -5), "one.tif"),
    "flats below darks": (swapped, "flats.tif"),
    "NaN in the flats": (lambda f: change_image(f / "flats.tif", np.nan), "flats.tif"),
    "truncated TIFF": (lambda f: cut(f / "one.tif", 0.6), "one.tif"),
    "truncated TIFF header": (lambda f: cut(f / "reference" / "7.tif", 0.02), "7.tif"),
    "truncated HDF5": (lambda f: as_hdf5(f, 0.6), "one.h5"),
    "empty HDF5": (lambda f: as_hdf5(f, 0.0), "one.h5"),
    "truncated npy": (lambda f: as_npy(f, 0.6), "one.npy"),
    "no TIFF at all": (lambda f: (f / "one.tif").write_text("hello, this is text"), "one.tif"),
    "air outside the panel": (toml("[volume]", "air = { margin = 90 }\n[volume]"), "reference.air.margin"),
    "missing start": (toml('name = "two"', 'name = "two"\ninitial = "start.csv"'), "start.csv"),
}  # fmt: skip


def assert_one_line(result_stderr, code, named):
    lines = result_stderr.strip().splitlines()
    assert code == 2, result_stderr
    assert len(lines) == 1, result_stderr
    assert lines[0].startswith("error: ")
    assert named in lines[0]
    assert "; " in lines[0]
    assert "Traceback" not in result_stderr


@pytest.mark.parametrize("case", CASES)
def test_refused(tiny, case):
    spoil, named = CASES[case]
    spoil(tiny)
    before = prints(tiny)
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, named)
    assert prints(tiny) == before


@pytest.mark.parametrize("threshold", ["50.0", "2.9"])
def test_no_grains_found(tiny, threshold):
    change(tiny / "experiment.toml", "threshold = 0.5", f"threshold = {threshold}")
    before = prints(tiny)
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, "no grains")
    after = prints(tiny)
    assert {name: after[name] for name in before} == before


@pytest.mark.parametrize("noise", [0, 300])
def test_empty_beam_has_no_grains(tiny, noise):
    rng = np.random.default_rng(0)
    for path in (tiny / "reference").iterdir():
        write_tiff(path, rng.normal(50_000, noise, PANEL).astype(np.uint16))
    change(tiny / "experiment.toml", "threshold = 0.5", "")
    before = prints(tiny)
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, "no grains found")
    assert prints(tiny) == before


@pytest.mark.parametrize("command", ["reconstruct", "segment", "track", "report", "inspect"])
def test_every_command_refuses_alike(tiny, command):
    cut(tiny / "one.tif", 0.6)
    before = prints(tiny)
    result = CliRunner().invoke(app, [command, str(tiny / "experiment.toml")])
    assert_one_line(result.stderr, result.exit_code, "one.tif")
    assert prints(tiny) == before


def test_through_the_installed_command(tiny):
    (tiny / "one.tif").unlink()
    done = subprocess.run(
        [sys.executable, "-c", "from grainmotion.cli.app import main; main()", "run", str(tiny / "experiment.toml")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert_one_line(done.stderr, done.returncode, "one.tif")


def test_results_folder_that_is_a_file(tiny):
    (tiny / "out").write_text("precious")
    result = CliRunner().invoke(app, ["run", str(tiny / "experiment.toml"), "--out", str(tiny / "out")])
    assert_one_line(result.stderr, result.exit_code, "out")
    assert (tiny / "out").read_text() == "precious"
