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
first_row = "bottom"
first = 0
last = 351
count = 40
"""
OPTIONS = ("--views", "2,3", "--step-deg", "30", "--quiet")


def invoke(*args):
    return CliRunner().invoke(app, ["plan", *(str(a) for a in args)])


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Path of the experiment and output of one `plan` command, shared by the tests of this module."""
    path = write_tiny(tmp_path_factory.mktemp("plans"))
    return path, invoke(path, *OPTIONS, "--photons", "5000")


class TestExperimentFile:
    def test_summary_is_printed_and_files_are_written(self, planned):
        path, result = planned
        assert result.exit_code == 0, result.output
        folder = path.parent / "results" / "plan"
        assert f"plan: {folder}" in result.stdout
        assert "5000 photons" in result.stdout
        assert {p.name for p in folder.iterdir()} == {"plan.csv", "angles.csv", "plan.png"}
        assert (folder / "plan.png").read_bytes().startswith(b"\x89PNG")

    def test_tables_of_precision_and_angles(self, planned):
        folder = planned[0].parent / "results" / "plan"
        table, angles = pd.read_csv(folder / "plan.csv"), pd.read_csv(folder / "angles.csv")
        assert tuple(table.columns) == PLAN_COLUMNS
        assert len(table) == 3 * 2 * 2
        assert np.all((table["sd_uz"] > 0) & (table["sd_uz"] < 0.5 * VOXEL))
        assert list(angles["set"]) == ["best", "even", "best", "even"]
        assert angles["angles_deg"].iloc[1] == "0 90"

    def test_states_are_not_tracked(self, planned):
        assert not (planned[0].parent / "results" / "one").exists()

    def test_settings_of_the_plan_table(self, planned, tmp_path):
        path = write_tiny(tmp_path, TOML + "\n[plan]\nphotons = 1234\nviews = [2]\nstep_deg = 45\n")
        assert read_experiment(path).tables.plan.views == (2,)
        result = invoke(path, "--quiet", "--out", tmp_path / "elsewhere")
        assert "1234 photons" in result.stdout
        assert (tmp_path / "elsewhere" / "plan" / "plan.csv").exists()
        assert not (tmp_path / "results").exists()

    def test_circular_scan_allows_any_angle(self, tmp_path):
        """The reference has a view every 9°; candidate views are at multiples of 20° nevertheless."""
        toml = TOML.replace('geometry = "reference.csv"\n', "").replace("[volume]", CIRCULAR + "\n[volume]")
        plan, _ = plan_experiment(
            read_experiment(write_tiny(tmp_path, toml + "\n[plan]\nviews = [2]\nstep_deg = 20\n"))
        )
        np.testing.assert_allclose(plan.angles_deg, np.arange(18) * 20, atol=1e-5)

    def test_geometry_csv_limits_candidates_to_its_views(self, planned, tmp_path):
        path = write_tiny(tmp_path, TOML + "\n[plan]\nviews = [2]\nstep_deg = 20\n")
        plan, _ = plan_experiment(read_experiment(path), out=planned[0].parent / "results")
        assert len(plan.angles_deg) == 18
        np.testing.assert_allclose(plan.angles_deg % 9, 0, atol=1e-5)

    def test_given_volume_is_planned_with_the_geometry_of_a_state(self, planned, tmp_path):
        export_reference(planned[0])
        results = planned[0].parent / "results"
        lines = TOML.split("[volume]", 1)[1] + "\n[plan]\nviews = [2, 3]\nspread = 0.5\n"
        head = '[reference]\nvolume = "reference.tif"\nlabels = "reference_labels.tif"\nflats = "flats.tif"\n'
        path = write_tiny(tmp_path, head + 'darks = "darks.tif"\n[volume]' + lines)
        for name in ("reference.tif", "reference_labels.tif"):
            (tmp_path / name).write_bytes((results / name).read_bytes())
        plan, _ = plan_experiment(read_experiment(path))
        assert len(plan.labels) == read_tiff(results / "reference_labels.tif").max()
        assert [len(s) for s in plan.sets if s.kind == "best"] == [2, 3]


def export_reference(path):
    result = CliRunner().invoke(app, ["export", str(path), "--format", "spam", "--quiet"])
    assert result.exit_code == 0, result.output


class TestSimulatedCase:
    def test_three_views_are_more_precise_than_two(self, tmp_path):
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
    def test_error_is_one_line_and_nothing_is_written(self, tmp_path, monkeypatch, arguments, words):
        monkeypatch.chdir(tmp_path)
        result = invoke(*arguments)
        assert result.exit_code == 2
        assert words in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
        assert not list(tmp_path.iterdir())

    def test_unknown_key_is_refused(self, tmp_path):
        result = invoke(write_tiny(tmp_path, TOML + "\n[plan]\nphoton = 3\n"))
        assert result.exit_code == 2
        assert "plan.photon: unknown key; did you mean 'photons'?" in result.stderr
