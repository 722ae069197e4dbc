"""Commands of `cli.app`: what they print, where they write, and their exit codes."""

import base64
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from grainmotion import __version__
from grainmotion.backends import device
from grainmotion.cli.app import app
from grainmotion.cli.demo import DEMO_STATES, write_case
from grainmotion.cli.interrupts import stoppable
from grainmotion.cli.progress import progress
from grainmotion.cli.terminal import Terminal
from grainmotion.io.motions_csv import read_motions
from grainmotion.io.spam import read_ddic_tsv
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.volume import Volume
from tiny_experiment import SHIFTS, write_tiny

COMMAND = [sys.executable, "-c", "from grainmotion.__main__ import main; main()"]


def invoke(*args):
    result = CliRunner().invoke(app, [str(a) for a in args])
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Path and output of one complete `run`, shared by the tests of this module."""
    path = write_tiny(tmp_path_factory.mktemp("cli") / "tiny")
    return path, invoke("run", path)


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of the finished run's folder, which a test may change."""
    shutil.copytree(finished[0].parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


class TestRun:
    def test_prints_residual_stages_and_report_path(self, finished):
        path, result = finished
        assert "ε = " in result.stderr  # progress
        assert "done: reconstruct, segment, one/track" in result.stdout
        assert f"report: {path.parent / 'results' / 'report.html'}" in result.stdout
        assert "error" not in result.stderr

    def test_results_are_written_beside_the_experiment_file(self, finished):
        motions = read_motions(finished[0].parent / "results" / "two" / "motions.csv")
        np.testing.assert_allclose(motions.translations, np.tile(SHIFTS["two"], (3, 1)), atol=0.02)

    def test_quiet_prints_the_report_path_only(self, copied):
        result = invoke("run", copied, "--quiet")
        assert "done" not in result.stdout
        assert "report: " in result.stdout

    def test_out_sets_the_results_folder(self, copied, tmp_path):
        shutil.move(copied.parent / "results", tmp_path / "elsewhere")
        result = invoke("run", copied, "--out", tmp_path / "elsewhere")
        assert "done: nothing" in result.stdout
        assert not (copied.parent / "results").exists()

    @pytest.mark.parametrize("command", ["reconstruct", "segment", "track", "report"])
    def test_commands_of_single_stages_reuse_finished_stages(self, copied, command):
        assert "done: nothing; kept: reconstruct" in invoke(command, copied).stdout


class TestDevice:
    def test_changing_the_device_reuses_finished_stages(self, copied):
        assert "done: nothing; kept: reconstruct" in invoke("run", copied, "--device", "cpu").stdout

    def test_unavailable_device_is_refused_before_any_work(self, tmp_path, monkeypatch):
        monkeypatch.setattr(device, "_cuda_problem", lambda: ("no GPU", "install one"))
        result = CliRunner().invoke(app, ["run", str(write_tiny(tmp_path)), "--device", "cuda"])
        assert result.exit_code == 2
        assert result.stderr == "error: device 'cuda': no GPU; install one\n"
        assert not (tmp_path / "results").exists()

    def test_device_of_the_experiment_file_is_the_default(self, tmp_path, monkeypatch):
        monkeypatch.setattr(device, "_cuda_problem", lambda: ("no GPU", "install one"))
        path = write_tiny(tmp_path)
        path.write_text(path.read_text().replace("search = false", 'search = false\ndevice = "cuda"'))
        assert CliRunner().invoke(app, ["run", str(path)]).exit_code == 2
        path.write_text(path.read_text().replace('"cuda"', '"gpu"'))
        assert "'auto', 'cpu' or 'cuda'" in CliRunner().invoke(app, ["run", str(path)]).stderr


class TestExport:
    def test_exports_to_vtk_and_spam(self, copied):
        invoke("export", copied, "--format", "vtk", "--format", "spam")
        results = copied.parent / "results"
        for name in SHIFTS:
            assert (results / name / "grains.vtp").exists()
            back = read_ddic_tsv(results / name / "grains-ddic.tsv", Volume.zeros((28, 36, 36), 0.1))
            np.testing.assert_allclose(back.translations, np.tile(SHIFTS[name], (3, 1)), atol=0.02)
        assert (results / "reference.vti").exists()
        assert read_tiff(results / "reference_labels.tif").max() == 3

    def test_the_word_files_and_the_order_of_options_do_not_matter(self, copied):
        for arguments in (
            ["files", copied, "--format", "vtk"],
            ["--format", "vtk", copied],
            ["-q", "--format=vtk", copied],
        ):
            assert "exported: " in invoke("export", *arguments).stdout

    def test_names_the_files_of_each_format(self, copied):
        formats = ("vtk", "tiff", "ome-zarr", "spam", "mechanics")
        lines = invoke("export", copied, *(word for name in formats for word in ("--format", name))).stdout.splitlines()
        told = [line.removeprefix("exported: ") for line in lines if line.startswith("exported: ")]
        results = copied.parent / "results"
        assert told[0] == str(results / "grains.pvd")
        assert str(results / "STATE" / "mechanics.json") in told
        assert len(told) == len(set(told)) == 14
        for name in SHIFTS:
            assert all(Path(path.replace("STATE", name)).exists() for path in told)

    def test_a_format_of_the_reference_names_no_state(self, copied):
        lines = invoke("export", copied, "--format", "ome-zarr").stdout.splitlines()
        told = [line for line in lines if line.startswith("exported: ")]
        assert told == [f"exported: {copied.parent / 'results' / 'reference.ome.zarr'}"]

    def test_help_lists_the_kinds_of_export(self):
        assert "files" in invoke("export", "--help").stdout
        assert "--format" in invoke("export", "files", "--help").stdout

    def test_point_of_files_for_spam(self, copied):
        invoke("export", copied, "--format", "spam", "--about", "box")
        header, first, *_ = (copied.parent / "results" / "one" / "grains-ddic.tsv").read_text().splitlines()
        assert float(first.split("\t")[header.split("\t").index("AboutBox")]) == 1

    def test_exports_bodies_for_dem_codes(self, copied):
        assert "exported: " in invoke("export", "dem", copied, "--shapes", "stl,clump", "--spheres", 3).stdout
        dem = copied.parent / "results" / "dem"
        assert sorted(p.name for p in dem.iterdir()) == [
            "README.txt", "clumps", "clumps.csv", "grains.csv", "poses.csv", "stl",
        ]  # fmt: skip
        poses = pd.read_csv(dem / "poses.csv")
        moved = poses.groupby("state")[["x", "y", "z"]].mean()
        for name in SHIFTS:
            np.testing.assert_allclose(moved.loc[name] - moved.loc["reference"], SHIFTS[name], atol=0.03)
        assert (poses["velocity_per"].iloc[3:] == "step").all()
        again = invoke("export", copied, "--format", "dem")  # with the settings of the file
        assert (dem / "level-set").is_dir()
        assert "done: dem; kept" in again.stdout
        for wrong in (["--spheres", 0], ["--shapes", "stl,ball"], ["--clump-fit", "near"], ["--degree", 99]):
            result = CliRunner().invoke(app, ["export", "dem", str(copied), *map(str, wrong)])
            assert result.exit_code == 2
            assert f"error: {wrong[0]}" in result.stderr

    def test_exports_mechanics_as_a_format(self, copied):
        invoke("export", copied, "--format", "mechanics")
        assert (copied.parent / "results" / "one" / "mechanics.json").exists()

    def test_unknown_format_is_refused(self, copied):
        result = CliRunner().invoke(app, ["export", str(copied), "--format", "dxf"])
        assert result.exit_code == 2
        assert "dxf" in result.stderr


class TestInspect:
    def test_describes_without_writing(self, tmp_path):
        path = write_tiny(tmp_path)
        text = invoke("inspect", path).stdout
        for words in ("40 x 28 x 36", "uint16", "states.two", "0.1 mm", "28 x 36 x 36 voxels", "GB"):
            assert words in text
        assert not (tmp_path / "results").exists()

    def test_tells_what_attenuates_in_the_reference_of_the_last_run(self, finished):
        text = invoke("inspect", finished[0], "--picture", finished[0].parent / "again.png").stdout
        assert "reference of the last run" in text
        assert "grains 9" in text  # more than 90 % of the attenuation
        assert ", 3\n" in text

    def test_warns_of_dead_pixels_air_and_single_views(self, tmp_path):
        path = write_tiny(tmp_path)
        flats = read_tiff(tmp_path / "flats.tif")
        flats[:, 3, 4] = 0
        write_tiff(tmp_path / "flats.tif", (flats * 0.9).astype(np.uint16))
        path.write_text(path.read_text().replace("angles_deg = [10.0, 55.0, 100.0]", "angles_deg = [10.0]"))
        np.save(tmp_path / "two.npy", np.load(tmp_path / "two.npy")[:1])
        text = invoke("inspect", path).stdout
        assert "3 dead" in text
        assert "the outermost columns have a line integral of -0.1" in text
        assert "states.two: one view" in text

    def test_draws_up_and_the_sense_of_rotation(self, tmp_path):
        path = write_tiny(tmp_path)
        text = invoke("inspect", path).stdout
        assert f"picture: {tmp_path / 'inspection.png'}" in text
        assert (tmp_path / "inspection.png").read_bytes()[1:4] == b"PNG"
        assert "row 0 is the lowest row" in text
        assert "seen from above it turns clockwise" in text

    def test_the_picture_goes_where_it_is_wanted(self, tmp_path):
        path = write_tiny(tmp_path)
        (tmp_path / "inspection.png").mkdir()  # cannot be replaced by a file
        assert "name another file with --picture" in " ".join(invoke("inspect", path).stdout.split())
        assert "picture:" in invoke("inspect", path, "--picture", tmp_path / "there.png").stdout
        assert (tmp_path / "there.png").exists()
        (tmp_path / "file").write_text("")
        result = CliRunner().invoke(app, ["inspect", str(path), "--picture", str(tmp_path / "file" / "x.png")])
        assert result.exit_code == 2


class TestProcess:
    def test_help_lists_the_commands_and_version_prints_it(self):
        text = invoke("--help").stdout
        for command in ("run", "reconstruct", "segment", "track", "report", "export", "inspect", "simulate", "demo"):
            assert command in text
        assert invoke("version").stdout.strip() == __version__

    def test_run_continues_after_interrupt_and_after_kill(self, tmp_path):
        """Ctrl-C and kill -9 leave complete files only, and the same command continues the run."""
        path = write_tiny(tmp_path)
        results = tmp_path / "results"
        first = _start_run(path)
        _wait_for_any(first, results / "reconstruction.h5", results / "reference.h5")
        first.send_signal(signal.SIGINT)
        _, errors = first.communicate()
        assert first.returncode == 130
        last = errors.strip().splitlines()[-1]
        assert last == "interrupted: finished stages are kept; the same command continues"
        second = _start_run(path)
        _wait_for_any(second, results / "one" / "motions.csv")
        second.kill()
        second.communicate()
        text = invoke("run", path).stdout
        assert "kept: reconstruct" in text
        assert set(SHIFTS) == {p.name for p in results.iterdir() if p.is_dir()}
        for name, shift in SHIFTS.items():
            motions = read_motions(results / name / "motions.csv")
            np.testing.assert_allclose(motions.translations, np.tile(shift, (3, 1)), atol=0.02)


def _start_run(path):
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    return subprocess.Popen(
        [*COMMAND, "run", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def _wait_for_any(process, *paths):
    """Wait until one of the files exists; there is no time limit here, because pytest has its own."""
    while not any(p.exists() for p in paths):
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)


@pytest.fixture
def default_sigint():
    """Python's own SIGINT handler, which a shell's background jobs lack and which other tests may replace."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("default_sigint")
def test_interrupt_swallowed_by_a_library_is_raised_at_the_next_step():
    with stoppable() as stop, progress(Terminal(quiet=True), stop) as listen:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            listen("next step", 1, 2)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class TestSimulated:
    def test_simulate_writes_an_experiment(self, tmp_path):
        text = invoke("simulate", tmp_path / "sim", "--case", "small", "--seed", 3).stdout
        assert f"experiment: {tmp_path / 'sim' / 'experiment.toml'}" in text
        assert len(list((tmp_path / "sim" / "reference").iterdir())) == 90
        assert "shift-2" in invoke("inspect", tmp_path / "sim" / "experiment.toml").stdout
        again = CliRunner().invoke(app, ["simulate", str(tmp_path / "sim")])
        assert again.exit_code == 2
        assert "already holds files" in again.stderr

    def test_an_earlier_demo_is_not_taken_for_one_of_another_seed(self, tmp_path):
        write_case(tmp_path, seed=4, states=DEMO_STATES)
        refused = CliRunner().invoke(app, ["demo", str(tmp_path), "--seed", "5"])
        assert refused.exit_code == 2
        assert f"error: --seed: {tmp_path} holds the demo of seed 4, not 5; choose another folder" in refused.stderr

    @pytest.mark.slow
    def test_demo_prints_errors_against_the_true_motions(self, tmp_path):
        text = invoke("demo", tmp_path / "demo").stdout
        rows = [line.split("│")[1:-1] for line in text.splitlines() if line.startswith("│")]
        assert [row[0].strip() for row in rows] == ["shift-4", "random-4"]
        for _, grains, failures, translations, rotations, voxels, degrees in rows:
            assert int(grains) == int(translations) == int(rotations) == 6
            assert int(failures) == 0
            assert float(voxels) < 0.1
            assert float(degrees) < 1.0
        *_, report, tables, log, after = text.strip().splitlines()
        assert report == f"report: {tmp_path / 'demo' / 'results' / 'report.html'}"
        assert tables.startswith("tables: ")
        assert log.startswith("log: ")
        assert "grainmotion init" in after
        page = (tmp_path / "demo" / "results" / "report.html").read_text(encoding="utf-8")
        fits = re.findall(r'"fit":\{"dtype":"json","data":"([^"]+)"', page)  # of each state, compressed
        assert len(fits) == 2
        assert all("rms a component" in zlib.decompress(base64.b64decode(fit)).decode() for fit in fits)
