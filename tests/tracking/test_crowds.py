"""Few grains of a large sample that fit badly (`tracking.crowds`): found without trials of the whole sample."""

import numpy as np
import pytest

import many_small_grains as many
from grainmotion.model.motions import Status
from grainmotion.tracking import crowds
from grainmotion.tracking.track import track

SIDE = 5


@pytest.fixture(scope="module")
def block():
    return many.block(SIDE)


def errors(measured, grains, pose, kept):
    """Of the translations of the grains ``kept`` that have one to use, voxels."""
    ok = measured.ok_translation[kept]
    return np.abs(measured.translations[kept] - pose.translations)[ok] / many.VOXEL


def test_an_absent_grain_is_named_and_disturbs_no_other(block):
    kept = np.delete(np.arange(len(block)), 62)
    scan, pose = many.state(block.without([62]), many.views(SIDE))
    measured = track(block, scan)
    assert measured.statuses[62] == Status.ABSENT.value, measured.reasons[62]
    assert np.isnan(measured.translations[62]).all()
    assert measured.ok_translation[kept].all()
    assert errors(measured, block, pose, kept).max() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "gone"), [(0, [31, 93]), (1, [10, 60, 118])])
def test_no_grain_that_is_there_is_called_absent(seed, gone):
    """Several at once of small grains, each of which disturbs all others."""
    grains = many.block(SIDE, seed)
    kept = np.delete(np.arange(len(grains)), gone)
    scan, pose = many.state(grains.without(gone), many.views(SIDE))
    measured = track(grains, scan)
    absent = measured.statuses == Status.ABSENT.value
    assert absent[gone].any()
    assert not absent[kept].any()
    assert not measured.ok_translation[gone].any(), "a grain that is not there has a motion"
    right = errors(measured, grains, pose, kept)
    assert np.median(right) < 0.05


def test_a_new_grain_is_found_and_disturbs_no_other(block):
    scan, pose = many.state(block, many.views(SIDE))
    measured = track(block.without([124]), scan)
    (new,) = measured.fit.appeared
    place = block.grains[124].center + pose.translations[124]
    assert np.linalg.norm(new.center - place) < many.VOXEL
    assert measured.ok_translation.all()
    moved = np.delete(pose.translations, 124, axis=0)
    assert np.abs(measured.translations - moved).max() < 0.05 * many.VOXEL


@pytest.mark.slow
def test_only_few_parts_are_searched(block, monkeypatch):
    """Whatever fits badly: an image of something else that no trial explains."""
    sought = []
    real = crowds.best_trial
    monkeypatch.setattr(crowds, "best_trial", lambda job, near: sought.append(len(job.grains)) or real(job, near))
    scan, _ = many.state(block, many.views(SIDE))
    images = scan.line_integrals.copy()
    rows, columns = images.shape[1:]
    images[:, rows // 2 - 2 : rows // 2 + 2, columns // 4 : columns // 2] += 0.5
    measured = track(block, type(scan)(images, scan.geometry))
    assert len(sought) <= crowds.MAX_FULL_PARTS
    assert max(sought, default=0) < len(block) / 2
    assert (measured.statuses == Status.ABSENT.value).sum() <= 1
