"""A run compares each state with the reference before it is tracked."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from grainmotion.experiment.config import read_experiment
from grainmotion.model.finding import Level
from grainmotion.tracking.track import TrackSettings
from grainmotion.workflow.run import RunResult, run
from tiny_experiment import SHIFTS, write_tiny


@pytest.fixture(scope="module")
def upside_down(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny experiment; the rows of its second state run the other way."""
    path = write_tiny(tmp_path_factory.mktemp("tiny"))
    two = path.parent / "two.npy"
    np.save(two, np.load(two)[:, ::-1])
    return path


def tracked(path: Path, *, force: bool = False, try_fixes: bool = False) -> RunResult:
    return run(read_experiment(path).checked(force=force, try_fixes=try_fixes), until="track")


def test_a_state_that_does_not_fit_is_refused_and_the_others_are_tracked(upside_down: Path):
    result = tracked(upside_down)
    (finding,) = (f for f in result.findings if f.where == "states.two")
    assert finding.level is Level.ERROR
    assert finding.fix == "rows-flipped"
    assert result.motions["one"].translations == pytest.approx(np.tile(SHIFTS["one"], (3, 1)), abs=0.02)
    assert set(result.motions["two"].statuses) == {"not-fitted"}
    assert "the state was not tracked: its views do not fit the reference" in result.motions["two"].reasons[0]
    again = tracked(upside_down)
    assert finding in again.findings  # from its file
    assert {"one/track", "two/track"} <= set(again.reused)


def test_its_fix_gives_the_true_motions(upside_down: Path):
    result = tracked(upside_down, try_fixes=True)
    two = result.motions["two"]
    assert two.translations == pytest.approx(np.tile(SHIFTS["two"], (3, 1)), abs=0.02)


def test_two_mistakes_are_fixed_one_after_the_other(tmp_path: Path):
    """Rows flipped and angles negated have one fix; what is left after a fix is found by another check."""
    path = write_tiny(tmp_path)
    path.write_text(path.read_text().replace("[10.0, 55.0, 100.0]", "[-10.0, -55.0, -100.0]"))
    two = path.parent / "two.npy"
    np.save(two, np.load(two)[:, ::-1])
    result = tracked(path, try_fixes=True)
    (finding,) = (f for f in result.findings if f.where == "states.two" and f.fix)
    assert finding.fix == "angles-negated, rows-flipped"
    assert finding.remedy.count("fixes = [") == 1
    assert result.motions["two"].translations == pytest.approx(np.tile(SHIFTS["two"], (3, 1)), abs=0.02)


def test_force_tracks_it_anyway(upside_down: Path, monkeypatch: pytest.MonkeyPatch):
    seen = []

    def noted(grains, scan, start, settings: TrackSettings, **options):
        seen.append(scan)
        raise KeyboardInterrupt

    monkeypatch.setattr("grainmotion.workflow.tracking_stage.track_with_residual", noted)
    with pytest.raises(KeyboardInterrupt):
        tracked(upside_down, force=True)
    assert len(seen) == 1
    assert dataclasses.is_dataclass(seen[0])
