"""A complete run: order of stages, files written, reuse of finished stages, and given volumes or labels."""

import shutil
from collections import Counter
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.findings_json import write_findings
from grainmotion.io.motions_csv import read_motions
from grainmotion.io.results import read_motions_h5, read_reference
from grainmotion.io.spam import write_ddic_tsv
from grainmotion.io.spam_table import DDIC_COLUMNS
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.finding import Finding, Level
from grainmotion.model.motions import Motions
from grainmotion.rotations import recenter
from grainmotion.workflow import reference_stages
from grainmotion.workflow import run as workflow
from tiny_experiment import BALLS, PANEL, SHIFTS, TOML, sample, write_tiny

SERIES_STAGES = ["series/h5", "series/csv"]
STATE_STAGES = ["one/track", "two/track", "one/residuals", "two/residuals", *SERIES_STAGES]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Path and result of one complete run, shared by the tests of this module."""
    path = write_tiny(tmp_path_factory.mktemp("finished") / "tiny")
    return path, workflow.run(read_experiment(path))


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of the finished run's folder, which a test may change."""
    shutil.copytree(finished[0].parent, tmp_path / "tiny")
    return tmp_path / "tiny" / "experiment.toml"


@pytest.fixture
def quick_track(copied, monkeypatch):
    """Replace tracking by the stored motions of state one; returns the list of initial motions it was given."""
    motions = read_motions_h5(copied.parent / "results" / "one" / "motions.h5")
    starts = []

    def stored_motions(grains, scan, start, *_, **__):
        starts.append(start)
        return motions, None

    monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", stored_motions)
    return starts


def run(path, old="", new="", **options):
    """Run the experiment after replacing `old` by `new` in its file."""
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    return workflow.run(read_experiment(path), **options)


class TestResults:
    def test_stages_in_order(self, finished):
        _, result = finished
        assert list(result.done) == ["reconstruct", "segment", *STATE_STAGES, "report"]
        assert result.reused == ()

    def test_motions_equal_the_truth(self, finished):
        path, result = finished
        for name, shift in SHIFTS.items():
            motions = read_motions(path.parent / "results" / name / "motions.csv")
            np.testing.assert_allclose(motions.translations, np.tile(shift, (3, 1)), atol=0.02)
            # The grains are balls: their rotations are undetermined, and the table reports it.
            assert (motions.statuses == "poorly-determined").all()
            assert all("rotation about" in r and "translation" not in r for r in result.motions[name].reasons)
            np.testing.assert_array_equal(result.motions[name].labels, motions.labels)

    def test_what_a_run_made_is_read_when_asked_for(self, finished, monkeypatch):
        path, _ = finished
        again = workflow.run(read_experiment(path))
        read = []
        monkeypatch.setattr(
            "grainmotion.io.results_folder.read_reference", lambda file: read.append(file) or read_reference(file)
        )
        assert "states one, two" in repr(again)
        assert again.series.states == ("one", "two")
        assert again.series["one"].fit is again.motions["one"].fit
        assert read == []
        assert again.grains.labels.tolist() == again.motions["one"].labels.tolist()
        assert again.volume.shape == again.labels.shape
        assert again.reference is again.results.reference
        assert len(read) == 1

    def test_motions_h5_agrees_with_motions_csv(self, finished):
        path, result = finished
        full = read_motions_h5(path.parent / "results" / "one" / "motions.h5")
        short = read_motions(path.parent / "results" / "one" / "motions.csv")
        np.testing.assert_allclose(full.translations, short.translations)
        np.testing.assert_array_equal(full.covariances, result.motions["one"].covariances)
        assert len(full.fit.costs) > 3
        assert full.fit.gain == pytest.approx(1, abs=0.02)

    def test_content_of_reference_h5(self, finished):
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

    def test_residual_images_contain_noise_only(self, finished):
        path, _ = finished
        residuals = read_tiff(path.parent / "results" / "one" / "residuals.tif")
        assert residuals.shape == (3, *PANEL)
        assert residuals.dtype == np.float32
        assert np.sqrt(np.mean(residuals**2)) < 0.05

    def test_residual_images_come_from_tracking(self, copied, finished, monkeypatch):
        """Simulated again from the stored motions, they are the same to rounding."""
        shutil.rmtree(copied.parent / "results" / "one")
        with monkeypatch.context() as patch:
            patch.setattr("grainmotion.workflow.outputs.residual_images", None)
            run(copied)
        path = copied.parent / "results" / "one" / "residuals.tif"
        kept = read_tiff(path)
        path.unlink()
        assert run(copied).done == ("one/residuals",)
        np.testing.assert_allclose(read_tiff(path), kept, atol=4e-6)

    def test_report_contains_the_names_of_states(self, finished):
        _, result = finished
        text = result.report.read_text()
        assert "one" in text
        assert "two" in text

    def test_no_other_files_are_written(self, finished):
        path, _ = finished
        names = {p.relative_to(path.parent / "results").as_posix() for p in (path.parent / "results").rglob("*")}
        states = {f"{s}/{f}" for s in SHIFTS for f in ("motions.csv", "motions.h5", "residuals.tif")}
        series = {"series.h5", "series.csv"}
        assert names == {
            "reference.h5",
            "report.html",
            "stages.json",
            "run.log",
            "datapackage.json",
            *series,
            *SHIFTS,
            *states,
        }


class TestFindings:
    def test_changed_findings_write_the_report_again(self, copied):
        found = Finding(Level.WARNING, "beam-level", "reference", "the beam fell by half", remedy="give flats")
        write_findings(copied.parent / "results" / "checks.json", (found,))
        result = run(copied)
        assert result.done == ("report",)
        assert result.findings == (found,)
        assert "the beam fell by half" in result.report.read_text()
        assert run(copied).done == ()

    def test_what_is_unusual_about_radiographs_is_kept_for_later_runs(self, copied):
        flats = read_tiff(copied.parent / "flats.tif")
        write_tiff(copied.parent / "flats.tif", (flats * 0.9).astype(np.uint16))
        first, again = run(copied, until="track"), run(copied, until="track")
        told = {f.where for f in first.findings if "outermost columns" in f.fact}
        assert told == {"reference", "states.one", "states.two"}
        assert again.findings == first.findings

    def test_grown_grid_is_told_by_later_runs_too(self, copied):
        first = run(copied, "sweeps = 3", "sweeps = 3\noutline = 2.2", until="segment")
        again = run(copied, until="segment")
        assert "reconstruct" in first.done
        assert again.done == ()
        assert "field-of-view" in {f.check for f in first.findings}
        assert again.findings == first.findings
        assert run(copied, "\noutline = 2.2", "", until="segment").findings == ()

    def test_common_cause_is_found_again_in_stored_motions(self, copied, monkeypatch):
        def nothing(grains, *_, **__):
            labels = np.arange(1, 7)
            motions = Motions.identity(labels, np.zeros((6, 3)))
            return replace(motions, reasons=tuple(f"grain {k} is broken" for k in labels)), None

        monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", nothing)
        shutil.rmtree(copied.parent / "results" / "two")
        first, again = run(copied, until="track"), run(copied, until="track")
        assert again.done == ()
        assert [f.check for f in first.findings] == ["common-cause"]
        assert first.findings == again.findings
        assert all(reason.startswith("see the common cause") for reason in again.motions["two"].reasons)


class TestRadiographs:
    @pytest.fixture
    def reads(self, monkeypatch):
        """Count how often each scan is read."""
        counts, read = Counter(), ScanInput.read_with_raw

        def counted(source):
            counts[source.key] += 1
            return read(source)

        monkeypatch.setattr(ScanInput, "read_with_raw", counted)
        return counts

    def test_each_scan_is_read_once(self, copied, reads):
        shutil.rmtree(copied.parent / "results")
        run(copied)
        assert reads == {"reference": 1, "states.one": 1, "states.two": 1}

    def test_continued_run_reads_only_the_scans_it_needs(self, copied, reads):
        for name in ("one/motions.csv", "one/residuals.tif", "report.html"):
            (copied.parent / "results" / name).unlink()
        assert run(copied).done == ("one/track", "one/residuals", "report")
        assert reads == {"states.one": 1, "states.two": 1}


class TestResume:
    def test_finished_run_does_nothing(self, copied):
        result = run(copied)
        assert result.done == ()
        assert set(result.motions) == set(SHIFTS)

    def test_changed_times_and_folders_of_inputs_are_ignored(self, copied):
        (copied.parent / "reference" / "0.tif").touch()
        assert run(copied).done == ()

    @pytest.mark.parametrize(
        ("old", "new", "repeated"),
        [
            ("search = false", "search = false\ngain = false", [*STATE_STAGES, "report"]),
            ("threshold = 0.5", "threshold = 0.45", ["segment", *STATE_STAGES, "report"]),
            ("sweeps = 3", "sweeps = 2", ["reconstruct", "segment", *STATE_STAGES, "report"]),
            ("55.0", "54.9", ["two/track", "two/residuals", *SERIES_STAGES, "report"]),
            ('radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "reference"',
             ["two/track", "two/residuals", *SERIES_STAGES, "report"]),
            ("[track]", "[output]\nrebuild = true\n[track]", ["one/rebuilt", "two/rebuilt"]),
            ("[track]", '[output]\nexports = ["vtk", "spam"]\n[track]',
             ["reference/vtk", "reference/spam", "one/vtk", "one/spam", "two/vtk", "two/spam", "collections"]),
            ("[track]", '[output]\nexports = ["tiff"]\n[track]', ["reference/tiff", "one/rebuilt", "two/rebuilt"]),
        ],
    )  # fmt: skip
    def test_changed_setting_repeats_the_stages_that_depend_on_it(self, copied, quick_track, old, new, repeated):
        assert sorted(run(copied, old, new).done) == sorted(repeated)
        assert run(copied).done == ()

    def test_changed_radiographs_repeat_their_state_and_the_next(self, copied, quick_track):
        images = read_tiff(copied.parent / "one.tif")
        images[0, 0, 0] += 1
        write_tiff(copied.parent / "one.tif", images)
        assert sorted(run(copied).done) == sorted([*STATE_STAGES, "report"])

    def test_missing_result_is_written_again(self, copied):
        (copied.parent / "results" / "one" / "residuals.tif").unlink()
        assert run(copied).done == ("one/residuals",)

    def test_run_interrupted_between_states_continues(self, copied, monkeypatch):
        kept = read_motions_h5(copied.parent / "results" / "one" / "motions.h5")
        shutil.rmtree(copied.parent / "results")
        calls = []

        def interrupted(grains, scan, start, *_, **__):
            calls.append(start)
            if len(calls) > 1:
                raise KeyboardInterrupt
            return kept, None

        monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(copied)
        assert not (copied.parent / "results" / "two").exists()
        calls.clear()
        result = run(copied)
        assert result.reused == ("reconstruct", "segment", "one/track")
        assert len(calls) == 1
        np.testing.assert_array_equal(calls[0][0].translations, kept.translations)

    def test_run_interrupted_in_segmentation_keeps_the_reconstruction(self, copied, monkeypatch):
        shutil.rmtree(copied.parent / "results")

        def interrupted(*_, **__):
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(reference_stages, "segment", interrupted)
            with pytest.raises(KeyboardInterrupt):
                run(copied)
        assert (copied.parent / "results" / "reconstruction.h5").exists()
        result = run(copied, until="segment")
        assert (result.reused, result.done) == (("reconstruct",), ("segment",))

    def test_damaged_stage_cache_repeats_all_stages(self, copied):
        (copied.parent / "results" / "stages.json").write_text("{")
        assert run(copied, until="segment").done == ("reconstruct", "segment")

    @pytest.mark.parametrize("name", ["reference.h5", "one/motions.h5"])
    def test_damaged_result_is_refused_with_a_remedy(self, copied, quick_track, name):
        path = copied.parent / "results" / name
        path.write_bytes(path.read_bytes()[:-500])
        if name == "reference.h5":
            (copied.parent / "results" / "report.html").unlink()
        with pytest.raises(InputError, match="delete it"):
            run(copied)
        path.unlink()
        run(copied)

    def test_result_over_an_input_is_refused(self, copied):
        (copied.parent / "one.tif").rename(copied.parent / "residuals.tif")
        with pytest.raises(InputError, match=r"residuals\.tif is an input and would be overwritten"):
            run(copied, 'radiographs = "one.tif"', 'radiographs = "residuals.tif"', out=copied.parent)

    def test_single_stages_together_make_the_whole_run(self, copied, quick_track):
        shutil.rmtree(copied.parent / "results")
        assert run(copied, until="reconstruct").done == ("reconstruct",)
        assert run(copied, until="segment").done == ("segment",)
        assert run(copied, until="track").done == ("one/track", "two/track")
        assert run(copied).done == ("one/residuals", "two/residuals", *SERIES_STAGES, "report")


class TestGivenVolume:
    def test_given_volume_and_labels_replace_their_stages(self, copied, finished):
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
            (np.full((28, 36, 36), -1), "no grains"),
            (np.full((28, 36, 36), 0.5), "whole numbers"),
            (np.ones((28, 36, 35)), "but the volume has"),
        ],
    )
    def test_bad_labels_are_refused(self, copied, labels, fact):
        np.save(copied.parent / "labels.npy", labels)
        with pytest.raises(InputError, match=rf"labels\.npy.*{fact}"):
            run(copied, "[volume]", 'labels = "labels.npy"\n[volume]')

    def test_initial_motions_from_a_table(self, copied, quick_track):
        run(copied, 'radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "results/one/motions.csv"')
        expected = read_motions(copied.parent / "results" / "one" / "motions.csv")
        np.testing.assert_array_equal(quick_track[-1][0].translations, expected.translations)

    def test_initial_motions_from_spam_are_about_boxes_unless_told(self, copied, quick_track):
        """A file about boxes, with the columns of spam-ddic alone: the labels' boxes are those of the reference."""
        stored = read_reference(copied.parent / "results" / "reference.h5")
        still = read_motions(copied.parent / "results" / "one" / "motions.csv")
        turned = replace(still, rotations=np.deg2rad([[50.0, 0, 0], [0, -40, 10], [20, 20, 20]]))
        write_ddic_tsv(copied.parent / "x.tsv", turned, stored.volume, stored.labels, about="box")
        table = pd.read_csv(copied.parent / "x.tsv", sep="\t")[list(DDIC_COLUMNS)]
        table.to_csv(copied.parent / "x.tsv", sep="\t", index=False, na_rep="nan")
        run(copied, 'radiographs = "two.npy"', 'radiographs = "two.npy"\ninitial = "x.tsv"')
        run(copied, 'initial = "x.tsv"', 'initial = "x.tsv"\ninitial_about = "centroid"')
        (by_box,), (by_centroid,) = quick_track
        back = recenter(by_box.matrices, by_box.translations, by_box.centers, turned.centers)
        np.testing.assert_allclose(back, turned.translations, atol=1e-6)
        assert np.abs(by_centroid.translations - by_box.translations).max() > 1e-4

    def test_point_of_a_start_that_is_not_of_spam_is_refused(self, copied):
        new = 'radiographs = "two.npy"\ninitial_about = "box"'
        with pytest.raises(
            InputError, match=r"states\.two\.initial_about: 'box', but initial = \"previous\" is no file"
        ):
            run(copied, 'radiographs = "two.npy"', new)

    def test_other_point_in_files_for_spam_writes_them_again(self, copied):
        run(copied, "[track]", '[output]\nexports = ["spam"]\n[track]')
        done = run(copied, 'exports = ["spam"]', 'exports = ["spam"]\nspam_about = "box"').done
        assert sorted(done) == ["one/spam", "two/spam"]
        table = pd.read_csv(copied.parent / "results" / "one" / "grains-ddic.tsv", sep="\t")
        assert set(table["AboutBox"]) == {1}

    def test_other_format_of_rebuilt_volumes_writes_them_again(self, copied):
        run(copied, "[track]", "[output]\nrebuild = true\n[track]")
        done = run(copied, "rebuild = true", 'rebuild = true\nvolumes = "hdf5"\nexports = ["tiff"]').done
        assert sorted(done) == ["one/rebuilt", "one/rebuilt tiff", "reference/tiff", "two/rebuilt", "two/rebuilt tiff"]
        assert (copied.parent / "results" / "one" / "rebuilt.h5").exists()

    def test_initial_motions_of_other_grains_are_refused(self, copied):
        table = read_motions(copied.parent / "results" / "one" / "motions.csv").to_table()
        table.iloc[:2].to_csv(copied.parent / "start.csv", index=False)
        new = 'radiographs = "two.npy"\ninitial = "start.csv"'
        with pytest.raises(InputError, match=r"states\.two.*start\.csv"):
            run(copied, 'radiographs = "two.npy"', new)
