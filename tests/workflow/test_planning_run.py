"""The command `plan`: from an experiment file or a simulated case to tables and a figure."""

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.experiment.config import read_experiment
from grainmotion.io.tiff import read_tiff
from grainmotion.planning.plan import PLAN_COLUMNS
from grainmotion.workflow.planning_run import plan_experiment
from tiny_experiment import TOML, VOXEL, write_tiny

CIRCULAR = """
[reference.geometry]
beam = "cone"
source_to_axis = 50
source_to_detector = 200
pixel_size = 0.4
first = 0
last = 351
count = 40
"""
OPTIONS = ("--views", "2,3", "--step-deg", "30", "--quiet")


def invoke(*args):
    return CliRunner().invoke(app, ["plan", *(str(a) for a in args)])


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A plan by the command, done once."""
    path = write_tiny(tmp_path_factory.mktemp("plans"))
    return path, invoke(path, *OPTIONS, "--photons", "5000")


class TestFromAFile:
    def test_prints_and_writes(self, done):
        path, result = done
        assert result.exit_code == 0, result.output
        folder = path.parent / "results" / "plan"
        assert f"plan: {folder}" in result.stdout
        assert "5000 photons" in result.stdout
        assert {p.name for p in folder.iterdir()} == {"plan.csv", "angles.csv", "plan.png"}
        assert (folder / "plan.png").read_bytes().startswith(b"\x89PNG")

    def test_tables(self, done):
        folder = done[0].parent / "results" / "plan"
        table, angles = pd.read_csv(folder / "plan.csv"), pd.read_csv(folder / "angles.csv")
        assert tuple(table.columns) == PLAN_COLUMNS
        assert len(table) == 3 * 2 * 2
        assert np.all((table["sd_uz"] > 0) & (table["sd_uz"] < 0.5 * VOXEL))
        assert list(angles["set"]) == ["best", "even", "best", "even"]
        assert angles["angles_deg"].iloc[1] == "0 90"

    def test_no_state_is_touched(self, done):
        assert not (done[0].parent / "results" / "one").exists()

    def test_table_of_the_file(self, done, tmp_path):
        path = write_tiny(tmp_path, TOML + "\n[plan]\nphotons = 1234\nviews = [2]\nstep_deg = 45\n")
        assert read_experiment(path).tables.plan.views == (2,)
        result = invoke(path, "--quiet", "--out", tmp_path / "elsewhere")
        assert "1234 photons" in result.stdout
        assert (tmp_path / "elsewhere" / "plan" / "plan.csv").exists()
        assert not (tmp_path / "results").exists()

    def test_circular_table_gives_any_angle(self, tmp_path):
        """The reference's 40 views stand 9° apart; the plan's candidates are exact."""
        toml = TOML.replace('geometry = "reference.csv"\n', "").replace("[volume]", CIRCULAR + "\n[volume]")
        found, _ = plan_experiment(
            read_experiment(write_tiny(tmp_path, toml + "\n[plan]\nviews = [2]\nstep_deg = 20\n"))
        )
        np.testing.assert_allclose(found.angles_deg, np.arange(18) * 20, atol=1e-5)

    def test_csv_gives_its_own_views(self, done, tmp_path):
        path = write_tiny(tmp_path, TOML + "\n[plan]\nviews = [2]\nstep_deg = 20\n")
        found, _ = plan_experiment(read_experiment(path), out=done[0].parent / "results")
        assert len(found.angles_deg) == 18
        np.testing.assert_allclose(found.angles_deg % 9, 0, atol=1e-5)

    def test_given_volume_takes_the_geometry_of_a_state(self, done, tmp_path):
        invoke_export(done[0])
        results = done[0].parent / "results"
        lines = TOML.split("[volume]", 1)[1] + "\n[plan]\nviews = [2, 3]\nspread = 0.5\n"
        head = '[reference]\nvolume = "reference.tif"\nlabels = "reference_labels.tif"\nflats = "flats.tif"\n'
        path = write_tiny(tmp_path, head + 'darks = "darks.tif"\n[volume]' + lines)
        for name in ("reference.tif", "reference_labels.tif"):
            (tmp_path / name).write_bytes((results / name).read_bytes())
        found, _ = plan_experiment(read_experiment(path))
        assert len(found.labels) == read_tiff(results / "reference_labels.tif").max()
        assert [len(s) for s in found.sets if s.kind == "best"] == [2, 3]


def invoke_export(path):
    result = CliRunner().invoke(app, ["export", str(path), "--format", "spam", "--quiet"])
    assert result.exit_code == 0, result.output


class TestFromACase:
    def test_small(self, tmp_path):
        result = invoke("--case", "small", "--out", tmp_path, *OPTIONS)
        assert result.exit_code == 0, result.output
        table = pd.read_csv(tmp_path / "plan" / "plan.csv")
        assert table["label"].nunique() == 6
        two, three = (table[(table["views"] == k) & (table["set"] == "best")]["sd_ux"].mean() for k in (2, 3))
        assert three < two


class TestBadInput:
    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ((), "neither an experiment file nor --case is given; give one of them"),
            (("no.toml", "--case", "small"), "a file and --case are both given"),
            (("no.toml",), "no such file"),
            (("--case", "small", "--views", "2,x"), "--views: '2,x' is no list of whole numbers; give them as 2,3,4,6"),
            (("--case", "small", "--views", "1"), "--views"),
            (("--case", "small", "--photons", "-3"), "--photons: input should be greater than 0, got -3.0"),
            (("--case", "small", "--step-deg", "0"), "--step-deg"),
        ],
    )
    def test_ends_in_one_line(self, tmp_path, monkeypatch, arguments, words):
        monkeypatch.chdir(tmp_path)
        result = invoke(*arguments)
        assert result.exit_code == 2
        assert words in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
        assert not list(tmp_path.iterdir())

    def test_unknown_key(self, tmp_path):
        result = invoke(write_tiny(tmp_path, TOML + "\n[plan]\nphoton = 3\n"))
        assert result.exit_code == 2
        assert "plan.photon: unknown key; did you mean 'photons'?" in result.stderr
