"""The order of a run: what it leaves behind, and that it goes on where it stopped."""

import shutil
from collections import Counter

import h5py
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.motions_csv import read_motions
from grainmotion.io.results import read_motions_h5, read_reference
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.workflow import reference_stages
from grainmotion.workflow import run as pipeline
from tiny_experiment import BALLS, PANEL, SHIFTS, TOML, sample, write_tiny

STATE_STAGES = ["one/track", "two/track", "one/residuals", "two/residuals"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A whole run, done once."""
    path = write_tiny(tmp_path_factory.mktemp("finished") / "tiny")
    return path, pipeline.run(read_experiment(path))


@pytest.fixture
def copied(finished, tmp_path):
    """The same run's folder, to be changed."""
    shutil.copytree(finished[0].parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


@pytest.fixture
def quick_track(copied, monkeypatch):
    """Instead of tracking, the first run's motions of the first state."""
    motions = read_motions_h5(copied.parent / "results" / "one" / "motions.h5")
    starts = []

    def known(grains, scan, start, *_, **__):
        starts.append(start)
        return motions, None

    monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", known)
    return starts


def run(path, old="", new="", **options):
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    return pipeline.run(read_experiment(path), **options)


class TestResults:
    def test_stages_in_order(self, finished):
        _, result = finished
        assert list(result.done) == ["reconstruct", "segment", *STATE_STAGES, "report"]
        assert result.reused == ()

    def test_motions_are_the_true_ones(self, finished):
        path, result = finished
        for name, shift in SHIFTS.items():
            motions = read_motions(path.parent / "results" / name / "motions.csv")
            np.testing.assert_allclose(motions.translations, np.tile(shift, (3, 1)), atol=0.02)
            # The grains are balls: nothing tells how they turn, and the table says so.
            assert (motions.statuses == "poorly-determined").all()
            assert all("rotation about" in r and "translation" not in r for r in result.motions[name].reasons)
            np.testing.assert_array_equal(result.motions[name].labels, motions.labels)

    def test_full_results_agree_with_the_table(self, finished):
        path, result = finished
        full = read_motions_h5(path.parent / "results" / "one" / "motions.h5")
        short = read_motions(path.parent / "results" / "one" / "motions.csv")
        np.testing.assert_allclose(full.translations, short.translations)
        np.testing.assert_array_equal(full.covariances, result.motions["one"].covariances)
        assert len(full.fit.costs) > 3
        assert full.fit.gain == pytest.approx(1, abs=0.02)

    def test_reference_file(self, finished):
        path, _ = finished
        reference = read_reference(path.parent / "results" / "reference.h5")
        assert len(reference.residuals) == 3
        assert reference.residuals[-1] < 0.05
        assert reference.threshold == 0.5
        assert reference.labels is not None
        assert set(np.unique(reference.labels)) == {0, 1, 2, 3}
        with h5py.File(path.parent / "results" / "reference.h5") as file:
            table = {name: file["grains"][name][()] for name in file["grains"]}
        assert set(table) == {"label", "x", "y", "z", "volume", "touches_border"}
        expected = sorted(4 / 3 * np.pi * ball[3] ** 3 for ball in BALLS)
        np.testing.assert_allclose(sorted(table["volume"]), expected, rtol=0.15)
        assert not (path.parent / "results" / "reconstruction.h5").exists()

    def test_residuals_are_noise(self, finished):
        path, _ = finished
        residuals = read_tiff(path.parent / "results" / "one" / "residuals.tif")
        assert residuals.shape == (3, *PANEL)
        assert residuals.dtype == np.float32
        assert np.sqrt(np.mean(residuals**2)) < 0.05

    def test_residuals_are_not_simulated_again(self, copied, finished, monkeypatch):
        """Tracking hands them on; made again from the stored motions they are the same to rounding."""
        shutil.rmtree(copied.parent / "results" / "one")
        with monkeypatch.context() as patch:
            patch.setattr("grainmotion.workflow.outputs.residual_images", None)
            run(copied)
        path = copied.parent / "results" / "one" / "residuals.tif"
        kept = read_tiff(path)
        path.unlink()
        assert run(copied).done == ("one/residuals",)
        np.testing.assert_allclose(read_tiff(path), kept, atol=4e-6)

    def test_report_names_the_states(self, finished):
        _, result = finished
        text = result.report.read_text()
        assert "one" in text
        assert "two" in text

    def test_nothing_else_is_left(self, finished):
        path, _ = finished
        names = {p.relative_to(path.parent / "results").as_posix() for p in (path.parent / "results").rglob("*")}
        states = {f"{s}/{f}" for s in SHIFTS for f in ("motions.csv", "motions.h5", "residuals.tif")}
        assert names == {"reference.h5", "report.html", "stages.json", *SHIFTS, *states}


class TestRadiographs:
    @pytest.fixture
    def reads(self, monkeypatch):
        """How often each scan was read."""
        counts, read = Counter(), ScanInput.read

        def counted(source):
            counts[source.key] += 1
            return read(source)

        monkeypatch.setattr(ScanInput, "read", counted)
        return counts

    def test_each_scan_is_read_once(self, copied, reads):
        shutil.rmtree(copied.parent / "results")
        run(copied)
        assert reads == {"reference": 1, "states.one": 1, "states.two": 1}

    def test_a_run_that_goes_on_reads_what_it_needs_once(self, copied, reads):
        for name in ("one/motions.csv", "one/residuals.tif", "report.html"):
            (copied.parent / "results" / name).unlink()
        assert run(copied).done == ("one/track", "one/residuals", "report")
        assert reads == {"states.one": 1, "states.two": 1}


class TestResume:
    def test_a_finished_run_does_nothing(self, copied):
        result = run(copied)
        assert result.done == ()
        assert set(result.motions) == set(SHIFTS)

    def test_touched_or_moved_files_are_the_same_files(self, copied):
        (copied.parent / "reference" / "0.tif").touch()
        assert run(copied).done == ()

    @pytest.mark.parametrize(
        ("old", "new", "redone"),
        [
            ("search = false", "search = false\ngain = false", [*STATE_STAGES, "report"]),
            ("threshold = 0.5", "threshold = 0.45", ["segment", *STATE_STAGES, "report"]),
            ("sweeps = 3", "sweeps = 2", ["reconstruct", "segment", *STATE_STAGES, "report"]),
            ("55.0", "54.9", ["two/track", "two/residuals", "report"]),
            ('radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "reference"',
             ["two/track", "two/residuals", "report"]),
            ("[track]", "[output]\nrebuild = true\n[track]", ["one/rebuilt", "two/rebuilt"]),
            ("[track]", '[output]\nexports = ["vtk", "spam"]\n[track]',
             ["reference/vtk", "reference/spam", "one/vtk", "one/spam", "two/vtk", "two/spam"]),
        ],
    )  # fmt: skip
    def test_a_changed_setting_redoes_what_depends_on_it(self, copied, quick_track, old, new, redone):
        assert sorted(run(copied, old, new).done) == sorted(redone)
        assert run(copied).done == ()

    def test_changed_radiographs_redo_their_state_and_the_next(self, copied, quick_track):
        images = read_tiff(copied.parent / "one.tif")
        images[0, 0, 0] += 1
        write_tiff(copied.parent / "one.tif", images)
        assert sorted(run(copied).done) == sorted([*STATE_STAGES, "report"])

    def test_a_missing_result_is_made_again(self, copied):
        (copied.parent / "results" / "one" / "residuals.tif").unlink()
        assert run(copied).done == ("one/residuals",)

    def test_a_run_killed_between_states_goes_on(self, copied, monkeypatch):
        kept = read_motions_h5(copied.parent / "results" / "one" / "motions.h5")
        shutil.rmtree(copied.parent / "results")
        calls = []

        def killed(grains, scan, start, *_, **__):
            calls.append(start)
            if len(calls) > 1:
                raise KeyboardInterrupt
            return kept, None

        monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", killed)
        with pytest.raises(KeyboardInterrupt):
            run(copied)
        assert not (copied.parent / "results" / "two").exists()
        calls.clear()
        result = run(copied)
        assert result.reused == ("reconstruct", "segment", "one/track")
        assert len(calls) == 1
        np.testing.assert_array_equal(calls[0].translations, kept.translations)

    def test_a_run_killed_in_segmentation_keeps_the_reconstruction(self, copied, monkeypatch):
        shutil.rmtree(copied.parent / "results")

        def killed(*_, **__):
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(reference_stages, "segment", killed)
            with pytest.raises(KeyboardInterrupt):
                run(copied)
        assert (copied.parent / "results" / "reconstruction.h5").exists()
        result = run(copied, until="segment")
        assert (result.reused, result.done) == (("reconstruct",), ("segment",))

    def test_a_broken_ledger_means_doing_it_again(self, copied):
        (copied.parent / "results" / "stages.json").write_text("{")
        assert run(copied, until="segment").done == ("reconstruct", "segment")

    @pytest.mark.parametrize("name", ["reference.h5", "one/motions.h5"])
    def test_a_damaged_result_says_what_to_do(self, copied, quick_track, name):
        path = copied.parent / "results" / name
        path.write_bytes(path.read_bytes()[:-500])
        if name == "reference.h5":
            (copied.parent / "results" / "report.html").unlink()
        with pytest.raises(InputError, match="delete it"):
            run(copied)
        path.unlink()
        run(copied)

    def test_no_result_over_an_input(self, copied):
        (copied.parent / "one.tif").rename(copied.parent / "residuals.tif")
        with pytest.raises(InputError, match=r"residuals\.tif is an input and would be overwritten"):
            run(copied, 'radiographs = "one.tif"', 'radiographs = "residuals.tif"', out=copied.parent)

    def test_stages_one_by_one_are_the_whole(self, copied, quick_track):
        shutil.rmtree(copied.parent / "results")
        assert run(copied, until="reconstruct").done == ("reconstruct",)
        assert run(copied, until="segment").done == ("segment",)
        assert run(copied, until="track").done == ("one/track", "two/track")
        assert run(copied).done == ("one/residuals", "two/residuals", "report")


class TestGivenVolume:
    def test_volume_and_labels_skip_their_stages(self, copied, finished):
        reference = read_reference(finished[1].folder / "reference.h5")
        np.save(copied.parent / "volume.npy", sample().array)
        write_tiff(copied.parent / "labels.tif", reference.labels)
        toml = TOML.replace('radiographs = "reference/*.tif"', 'volume = "volume.npy"\nlabels = "labels.tif"')
        copied.write_text(toml.replace('geometry = "reference.csv"', 'beam = "cone"').replace("shape =", "# "))
        result = run(copied)
        assert list(result.done) == ["segment", *STATE_STAGES, "report"]
        for name, shift in SHIFTS.items():
            np.testing.assert_allclose(result.motions[name].translations, np.tile(shift, (3, 1)), atol=0.01)
        assert run(copied).done == ()

    @pytest.mark.parametrize(
        ("labels", "fact"),
        [
            (np.zeros((28, 36, 36)), "no grains"),
            (np.full((28, 36, 36), -1), "whole numbers"),
            (np.full((28, 36, 36), 0.5), "whole numbers"),
            (np.ones((28, 36, 35)), "but the volume has"),
        ],
    )
    def test_bad_labels(self, copied, labels, fact):
        np.save(copied.parent / "labels.npy", labels)
        with pytest.raises(InputError, match=rf"labels\.npy.*{fact}"):
            run(copied, "[volume]", 'labels = "labels.npy"\n[volume]')

    def test_start_from_a_table(self, copied, quick_track):
        run(copied, 'radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "results/one/motions.csv"')
        expected = read_motions(copied.parent / "results" / "one" / "motions.csv")
        np.testing.assert_array_equal(quick_track[-1].translations, expected.translations)

    def test_start_of_other_grains_is_refused(self, copied):
        table = read_motions(copied.parent / "results" / "one" / "motions.csv").to_table()
        table.iloc[:2].to_csv(copied.parent / "start.csv", index=False)
        new = 'radiographs = "two.npy"\ninitial = "start.csv"'
        with pytest.raises(InputError, match=r"states\.two.*start\.csv"):
            run(copied, 'radiographs = "two.npy"', new)
