"""Check of a full scan: each mistake is named by its cause, and sound scans are left alone."""

from __future__ import annotations

import numpy as np
import pytest

import grainmotion as gm
from grainmotion.diagnosis.hypotheses import HYPOTHESES
from grainmotion.simulate import Particle, Physics, Sample, random_polyhedron, record_line_integrals

PANEL, VOXEL, VIEWS = (32, 32), 0.25, 36
CENTERS = np.array([[-1.6, -1.2, -1.3], [1.4, -1.5, -1.2], [0.1, 1.8, -1.0], [-1.4, 0.7, 1.3], [1.6, 0.4, 1.2]])
FULL_TURN = np.arange(VIEWS) * 360 / VIEWS


def views(angles_deg: np.ndarray, shape: tuple[int, int] = PANEL) -> gm.Geometry:
    return gm.Geometry.cone(angles_deg, shape, 4 * VOXEL, source_to_axis=60, source_to_detector=240)


@pytest.fixture(scope="module")
def sample() -> Sample:
    draws = np.random.default_rng(5)
    return Sample(tuple(Particle(random_polyhedron(draws, 2.3).moved(np.eye(3), c), 0.15) for c in CENTERS))


@pytest.fixture(scope="module")
def images(sample: Sample) -> np.ndarray:
    return record_line_integrals(sample, views(FULL_TURN), Physics(photons=20_000.0), 1).line_integrals


def check(images: np.ndarray, geometry: gm.Geometry) -> tuple[gm.Finding, ...]:
    return gm.check_scan(gm.Scan(images, geometry), gm.Volume.zeros((32, 32, 32), VOXEL))


def test_sound_scan_gives_no_finding(images):
    assert check(images, views(FULL_TURN)) == ()


def test_negated_angles_are_named_and_the_columns_beside_them(images):
    """The axis is off by 2 pixels, too."""
    (finding,) = check(np.roll(images, 2, axis=2), views(-FULL_TURN))
    assert (finding.level, finding.check, finding.fix) == (gm.Level.ERROR, "sense-of-rotation", "angles-negated")
    assert "columns" in finding.fact
    assert "columns-flipped" in finding.remedy
    assert "states that have the same mistake, and for no other" in finding.remedy


@pytest.mark.parametrize(
    ("angles", "fix"),
    [
        (np.deg2rad(FULL_TURN), "angles-in-radians"),
        (np.arange(VIEWS) * 360 / (VIEWS - 1), "end-point-counted"),
    ],
)
def test_wrong_angles_are_named(images, angles, fix):
    (finding,) = check(images, views(angles))
    assert (finding.level, finding.fix) == (gm.Level.ERROR, fix)


def test_exchanged_rows_and_columns_are_named(images):
    (finding,) = check(images.swapaxes(1, 2).copy(), views(FULL_TURN))
    assert finding.level is gm.Level.ERROR
    assert "quarter-turned" in finding.remedy


def test_files_sorted_as_text_are_named(images):
    order = sorted(range(VIEWS), key=str)
    (finding,) = check(images[order], views(FULL_TURN))
    assert (finding.level, finding.fix) == (gm.Level.ERROR, "sorted-as-text")


def test_stack_of_sinograms_is_named(sample):
    geometry = views(FULL_TURN, (VIEWS, 32))
    scan = record_line_integrals(sample, geometry, Physics(photons=20_000.0), 1)
    (finding,) = check(scan.line_integrals.swapaxes(0, 1).copy(), geometry)
    assert finding.level is gm.Level.ERROR
    assert "sinograms" in finding.fact


def test_fix_gives_a_sound_scan(images):
    """The named fix, applied to the geometry, leaves nothing to say."""
    wrong = views(FULL_TURN / 2)
    (finding,) = check(images, wrong)
    assert check(images, HYPOTHESES[finding.fix].change(wrong)) == ()


def test_black_radiograph_is_named_by_its_view(images):
    black = images.copy()
    black[13] = 9.0
    (finding,) = check(black, views(FULL_TURN))
    assert finding.fix == ""
    assert "view 13" in finding.evidence


def test_random_order_has_no_fix(images):
    (finding,) = check(images[np.random.default_rng(0).permutation(VIEWS)], views(FULL_TURN))
    assert (finding.level, finding.fix) == (gm.Level.ERROR, "")
    assert "all views" in finding.evidence


def test_parallel_beam_does_not_tell_the_sense_of_rotation(sample):
    """Its mirror image fits exactly as well: a note, and nothing more."""
    geometry = gm.Geometry.parallel(FULL_TURN / 2, PANEL, VOXEL)
    scan = record_line_integrals(sample, geometry, Physics(photons=20_000.0), 2)
    (finding,) = check(scan.line_integrals, gm.Geometry.parallel(-FULL_TURN / 2, PANEL, VOXEL))
    assert (finding.level, finding.check) == (gm.Level.NOTE, "sense-of-rotation")


@pytest.mark.parametrize("number", [12, 20])
def test_few_views_are_judged_by_what_they_can_reach(images, number):
    """Half of 12 views leaves 0.3 of a sound scan: nothing to warn of."""
    chosen = np.linspace(0, VIEWS, number, endpoint=False).astype(int)
    findings = check(images[chosen], views(FULL_TURN[chosen]))
    assert all(f.level is gm.Level.NOTE for f in findings)


def test_too_few_views_are_not_judged(images):
    assert check(images[:8], views(FULL_TURN[:8])) == ()
