"""The curve of beam hardening that a full scan shows by itself, on ellipsoids in a tube (no projector of ours)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from grainmotion.model.geometry import Geometry
from grainmotion.model.hardening import Hardening
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.hardening import consistent_hardening
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import Ellipsoid, Particle, Sample, Tube, line_integrals
from grainmotion.tracking.track import track

VOXEL = 0.1
GEOMETRY = Geometry.cone(np.arange(36) * 10.0, (36, 48), 4 * VOXEL, source_to_axis=40, source_to_detector=160)
LATER = Geometry.cone((0.0, 45.0, 90.0, 135.0), (36, 48), 4 * VOXEL, source_to_axis=40, source_to_detector=160)
GRID = Volume.zeros((36, 48, 48), VOXEL)
Spectrum = tuple[tuple[float, float], ...]
SPECTRUM: Spectrum = ((0.3, 1.6), (0.5, 0.9), (0.2, 0.35))  # mean 1


def sample(attenuations: tuple[float, ...]) -> Sample:
    """Ellipsoids on a ring and one in the middle, in a tube."""
    places = [(1.1 * np.cos(a), 1.1 * np.sin(a), 0.3 * np.sin(3 * a)) for a in np.arange(5) * 1.2566] + [(0, 0, 0)]
    particles = [
        Particle(Ellipsoid(np.array(p), np.array([0.4, 0.5, 0.65]), rotation_matrix([0.7 * k, 0.3, -0.2 * k])), value)
        for k, (p, value) in enumerate(zip(places, attenuations, strict=True))
    ]
    return Sample(tuple(particles), Tube(1.9, 2.1, 0.15))


@cache
def scan(spectrum: Spectrum = ((1.0, 1.0),), attenuations: tuple[float, ...] = (0.6,) * 6) -> Scan:
    images = line_integrals(sample(attenuations), GEOMETRY, subsamples=2, spectrum=spectrum)
    noise = 0.005 * np.random.default_rng(1).standard_normal(images.shape)
    return Scan((images + noise).astype(np.float32), GEOMETRY)


def curve(some: Scan) -> Hardening:
    return consistent_hardening(some.select, some.geometry, GRID, ReconstructSettings())


def error(some: Scan, truth: Scan) -> float:
    return float(np.linalg.norm(some.line_integrals - truth.line_integrals) / np.linalg.norm(truth.line_integrals))


@pytest.mark.parametrize("attenuations", [(0.6,) * 6, (0.9, 0.3, 0.6, 0.4, 0.8, 0.5)])
def test_polychromatic_scan_shows_its_curve_whatever_the_materials(attenuations: tuple[float, ...]) -> None:
    hard, ideal = (scan(spectrum, attenuations) for spectrum in (SPECTRUM, ((1.0, 1.0),)))  # with the same noise
    found = curve(hard)
    assert error(found.apply(hard), ideal) < 0.25 * error(hard, ideal)
    assert found.departure > 5 * found.sd


@pytest.mark.parametrize("attenuations", [(0.6,) * 6, (0.9, 0.3, 0.6, 0.4, 0.8, 0.5)])
def test_monochromatic_scan_shows_none(attenuations: tuple[float, ...]) -> None:
    assert curve(scan(attenuations=attenuations)).is_linear


def test_a_beam_that_drifts_or_a_shifted_panel_is_no_hardening() -> None:
    drifting = scan().levelled(np.linspace(-0.02, 0.02, len(GEOMETRY)))
    assert curve(drifting).is_linear
    vectors = GEOMETRY.vectors.copy()
    vectors[:, 3:6] += 0.5 * vectors[:, 6:9]
    assert curve(replace(scan(), geometry=Geometry(vectors, GEOMETRY.shape, "cone"))).is_linear


def test_masked_pixels_carry_no_weight() -> None:
    some = scan(SPECTRUM)
    images, valid = some.line_integrals.copy(), np.ones(some.line_integrals.shape, bool)
    images[:, 10:12, 20:23], valid[:, 10:12, 20:23] = 3.0, False
    assert curve(Scan(images, GEOMETRY, valid)).departure == pytest.approx(curve(some).departure, rel=0.1)


def test_volume_and_states_are_linearised_by_the_same_curve() -> None:
    hard = reconstruct(scan(SPECTRUM), GRID, ReconstructSettings(sweeps=3)).volume
    raw = reconstruct(scan(SPECTRUM), GRID, ReconstructSettings(sweeps=3, hardening=False)).volume
    soft = reconstruct(scan(), GRID, ReconstructSettings(sweeps=3)).volume
    assert [volume.hardening.is_linear for volume in (hard, raw, soft)] == [False, True, True]
    inside = soft.array > 0.45
    hard_mean, raw_mean, mean = (volume.array[inside].mean() for volume in (hard, raw, soft))
    assert hard_mean == pytest.approx(mean, rel=0.03)  # what is left is a gain, which states have free
    assert raw_mean < 0.96 * mean
    labels = np.zeros(hard.shape, np.int32)
    labels[:, 24:], labels[:, :24] = 1, 2
    grains = grains_from_labels(hard, np.where(hard.array > 0.3, labels, 0).astype(np.int32))
    assert grains.scene.hardening == hard.hardening
    state = Scan(line_integrals(sample((0.6,) * 6), LATER, subsamples=2, spectrum=SPECTRUM).astype(np.float32), LATER)
    response = track(grains, state).fit.response
    assert response is not None
    assert response.polynomial.shape[1] == 1
    assert response.polynomial[:, 0] == pytest.approx(1.0, abs=0.02)
