"""Frames, pixels and grey values that are wrong in one way are named, sound ones give no finding."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from ball_radiographs import BEAM, DARK, Measured, line_integrals, measured, transmissions
from grainmotion.diagnosis import frames
from grainmotion.diagnosis.grey_values import stretched
from grainmotion.errors import InputError
from grainmotion.model.finding import Level
from grainmotion.preprocessing.outliers import spikes, stuck_pixels

Change = Callable[[Measured, np.random.Generator], Measured]


def some(rng, count, most):
    return rng.permutation(count)[: rng.integers(1, most + 1)]


def replaced(stack, frames, values):
    out = stack.copy()
    out[frames] = values
    return out


def empty_flats(scan, rng):
    return scan.having(flats=replaced(scan.flats, some(rng, 8, 5), 0))


def flats_with_the_shutter_closed(scan, rng):
    frames = some(rng, 8, 5)
    return scan.having(flats=replaced(scan.flats, frames, scan.darks[frames]))


def flats_with_the_sample(scan, rng):
    frames = some(rng, 8, 3)
    return scan.having(flats=replaced(scan.flats, frames, scan.images[rng.integers(0, len(scan.images), len(frames))]))


def darks_with_the_beam(scan, rng):
    frames = some(rng, 8, 2)
    return scan.having(darks=replaced(scan.darks, frames, scan.flats[frames]))


def all_flats_with_the_sample(scan, rng):
    return scan.having(flats=scan.images[rng.integers(0, len(scan.images), 1)])


def black_radiograph(scan, rng):
    frame = rng.integers(len(scan.images))
    return scan.having(images=replaced(scan.images, frame, rng.poisson(DARK, scan.images.shape[1:])))


def copied_radiograph(scan, rng):
    source, copy = rng.permutation(len(scan.images))[:2]
    return scan.having(images=replaced(scan.images, copy, scan.images[source]))


def radiograph_of_another_view(scan, rng):
    frame = rng.integers(len(scan.images))
    other = line_integrals(scan.angles_deg[[frame]] + rng.uniform(60, 120))
    return scan.having(images=replaced(scan.images, frame, rng.poisson(BEAM * np.exp(-other)) + DARK))


def view_taken_twice(scan, rng):
    """The stage stood still for one step."""
    frame = rng.integers(len(scan.images) - 1)
    again = line_integrals(scan.angles_deg[[frame]])
    return scan.having(images=replaced(scan.images, frame + 1, rng.poisson(BEAM * np.exp(-again)) + DARK))


def short_exposure(scan, rng):
    frame = rng.integers(len(scan.images))
    return scan.having(images=replaced(scan.images, frame, DARK + (scan.images[frame] - float(DARK)) / 2))


def offset_of_signed_numbers(scan, rng):
    return scan.having(images=scan.images + np.uint16(32768))


def offset_in_a_beam_brighter_on_one_side(scan, rng):
    bright = np.linspace(1.04, 0.96, scan.images.shape[2])

    def lit(images):
        return (bright * (images - float(DARK)) + DARK).astype(np.uint16)

    return scan.having(images=lit(scan.images) + np.uint16(32768), flats=lit(scan.flats))


def flats_of_a_shorter_exposure(scan, rng):
    return scan.having(flats=DARK + (scan.flats - float(DARK)) / 4)


def inverted(scan, rng):
    return scan.having(images=np.uint16(2 * BEAM + DARK) - scan.images)


def camera_of_12_bits(scan, rng):
    """Radiographs whose air is at the top of the range, flats of a shorter exposure."""

    def bits(images, top):
        return (images * (top / BEAM)).clip(0, 4095).astype(np.uint16)

    return scan.having(images=bits(scan.images, 4300), flats=bits(scan.flats, 3500), darks=bits(scan.darks, 3500))


def transmissions_as_line_integrals(scan, rng):
    return scan.having(images=transmissions(scan), flats=None, darks=None, kind="line-integrals")


def line_integrals_as_transmissions(scan, rng):
    images = np.abs(-np.log(transmissions(scan)))
    return scan.having(images=images, flats=None, darks=None, kind="transmission")


def wrong_sign(scan, rng):
    return scan.having(images=np.log(transmissions(scan)), flats=None, darks=None, kind="line-integrals")


def eight_bits_beside_flats_of_sixteen(scan, rng):
    return scan.having(images=np.clip(scan.images / 90, 0, 255).astype(np.uint8), darks=None)


def flat_among_the_radiographs(scan, rng):
    return scan.having(images=np.concatenate([scan.flats[:1], scan.images[:-1]]))


def automatic_contrast(scan, rng):
    low, high = (f(scan.images.astype(float), axis=(1, 2), keepdims=True) for f in (np.min, np.max))
    return scan.having(images=np.round((scan.images - low) / (high - low) * 65_535).astype(np.uint16))


WRONG: dict[Change, tuple[str, Level, str]] = {
    automatic_contrast: ("kind", Level.ERROR, "automatic contrast"),
    eight_bits_beside_flats_of_sixteen: ("kind", Level.ERROR, "the radiographs were scaled"),
    flat_among_the_radiographs: ("frames", Level.ERROR, "without a sample"),
    empty_flats: ("beam-images", Level.WARNING, "left out of the mean"),
    flats_with_the_shutter_closed: ("beam-images", Level.WARNING, "left out of the mean"),
    flats_with_the_sample: ("beam-images", Level.WARNING, "left out of the mean"),
    darks_with_the_beam: ("beam-images", Level.WARNING, "shutter open"),
    all_flats_with_the_sample: ("sign", Level.WARNING, "brighter than the flats"),
    black_radiograph: ("frames", Level.ERROR, "black"),
    copied_radiograph: ("frames", Level.WARNING, "copied twice"),
    radiograph_of_another_view: ("frames", Level.WARNING, "unlike those before and after"),
    view_taken_twice: ("frames", Level.WARNING, "differ by noise alone"),
    short_exposure: ("frames", Level.WARNING, "far brighter or darker"),
    offset_of_signed_numbers: ("offset", Level.ERROR, "half of the range of 16 bits"),
    offset_in_a_beam_brighter_on_one_side: ("offset", Level.ERROR, "half of the range of 16 bits"),
    flats_of_a_shorter_exposure: ("beam-level", Level.WARNING, "brighter than the open beam"),
    inverted: ("sign", Level.ERROR, "inverted"),
    camera_of_12_bits: ("saturation", Level.WARNING, "4095"),
    transmissions_as_line_integrals: ("kind", Level.ERROR, "look like transmission"),
    line_integrals_as_transmissions: ("kind", Level.ERROR, "look like line-integrals"),
    wrong_sign: ("sign", Level.ERROR, "sign of the line integrals"),
}


REFERENCE_ONLY = {radiograph_of_another_view, view_taken_twice, short_exposure, flat_among_the_radiographs}


def check(change, seed, state):
    scan = change(measured(seed, state=state), np.random.default_rng(seed + 1))
    name, level, words = WRONG[change]
    found = scan.findings()
    assert any(f.check == name and words in f.fact and f.level in (level, Level.ERROR) for f in found), found


@pytest.mark.parametrize("change", WRONG, ids=lambda change: change.__name__)
class TestWrongInput:
    def test_is_named(self, change):
        check(change, 0, state=False)
        if change not in REFERENCE_ONLY:
            check(change, 0, state=True)

    @pytest.mark.slow
    @pytest.mark.parametrize("seed", range(1, 21))
    def test_is_named_with_other_seeds(self, change, seed):
        check(change, seed, state=False)
        if change not in REFERENCE_ONLY:
            check(change, seed, state=True)


class TestSoundInput:
    @pytest.mark.parametrize("photons", [100, 1000, 20_000])
    @pytest.mark.parametrize("state", [False, True])
    def test_no_finding_and_nothing_masked(self, photons, state):
        scan = measured(3, state=state, photons=photons)
        assert scan.findings() == ()
        assert scan.read().scan.valid is None

    @pytest.mark.parametrize("kind", ["transmission", "line-integrals"])
    def test_other_kinds(self, kind):
        scan = measured(4)
        images = transmissions(scan) if kind == "transmission" else -np.log(transmissions(scan))
        assert scan.having(images=images, kind=kind, flats=None, darks=None).findings() == ()

    def test_a_dead_and_a_hot_pixel_are_no_automatic_contrast(self):
        images = measured(6).images.copy()
        images[:, 3, 4], images[:, 20, 7] = 0, 65_535
        assert not stretched(images)
        assert stretched(automatic_contrast(measured(6), None).images)

    def test_noise_free_images(self):
        lines = line_integrals(np.arange(48) * 7.5).astype(np.float32)
        scan = measured(5).having(images=lines, kind="line-integrals", flats=None, darks=None)
        assert scan.findings() == ()
        assert scan.read().scan.valid is None

    @pytest.mark.parametrize("seed", range(3))
    def test_rows_of_grains(self, seed):
        """Views along the rows change several times as fast as others; one from elsewhere among them is named."""
        places = np.stack(np.meshgrid(*3 * [6.0 * np.arange(-2, 3)], indexing="ij"), axis=-1).reshape(-1, 3)
        places += np.random.default_rng(seed).uniform(-0.3, 0.3, places.shape)
        angles = np.arange(240) * 1.5
        lines = line_integrals(angles, np.column_stack([places, np.full(len(places), 2.8)]))
        images = np.random.default_rng(seed).poisson(BEAM * np.exp(-lines)) + DARK
        scan = measured(5).having(images=images, angles_deg=angles)
        assert not [finding for finding in scan.findings() if finding.check == "frames"]
        spoiled = replaced(images, 61, images[105] + 1)
        facts = [finding.fact for finding in scan.having(images=spoiled).findings()]
        assert any("radiograph 61 (from 0): unlike those before and after" in fact for fact in facts), facts

    @pytest.mark.parametrize("end", ["first", "last"])
    def test_the_first_and_the_last_view_along_rows_of_grains(self, end):
        """They have a neighbour on one side only: a view from elsewhere shows by the usual step next to it."""
        rng = np.random.default_rng(0)

        def found(steps):
            blocks = np.cumsum(steps[:, None] * rng.normal(size=(len(steps), 400)), axis=0)
            blocks = blocks if end == "first" else blocks[::-1]
            black = np.zeros(len(blocks), bool)
            read = SimpleNamespace(key="a", names={"radiographs": "a"}, black=black, blocks=blocks)
            return [finding.fact for finding in frames._unlike(read)]

        along_rows, usual = np.ones(100), np.ones(100)
        along_rows[1:6], usual[1] = (2.3, 2.6, 3.0, 2.6, 2.0), 3.0
        assert found(along_rows) == []
        number = 0 if end == "first" else 99
        assert f"radiograph {number} (from 0)" in found(usual)[0]

    def test_edges_of_a_dense_sample_are_no_outliers(self):
        rng = np.random.default_rng(0)
        for line in line_integrals(np.arange(20) * 18.0) * 6:
            ideal = np.exp(-line).astype(np.float32)
            noisy = (rng.poisson(400 * ideal) / 400).astype(np.float32)
            for image in (ideal, noisy):
                assert not spikes(image, image > 0).any()

    @pytest.mark.slow
    @pytest.mark.parametrize("seed", range(20))
    @pytest.mark.parametrize("photons", [100, 1000, 20_000])
    @pytest.mark.parametrize("state", [False, True])
    def test_no_finding_with_other_seeds(self, seed, photons, state):
        scan = measured(seed, state=state, photons=photons)
        assert scan.findings() == ()
        assert scan.read().scan.valid is None


class TestPixels:
    def test_zingers_are_masked_and_nothing_else(self):
        rng, scan = np.random.default_rng(1), measured(1)
        hit = rng.random(scan.images.shape) < 1e-3
        images = (scan.images + hit * rng.uniform(20_000, 40_000, hit.shape)).clip(0, 60_000).astype(np.uint16)
        read = scan.having(images=images).read()
        masked = ~read.scan.valid
        assert (masked & hit).sum() > 0.97 * hit.sum()
        assert (masked & ~hit).sum() < 1e-4 * hit.size
        truth = line_integrals(scan.angles_deg)
        assert np.abs(read.scan.line_integrals - truth)[masked].mean() < 0.05

    def test_zingers_in_flats_are_left_out(self):
        rng, scan = np.random.default_rng(2), measured(2)
        hit = rng.random(scan.flats.shape) < 2e-3
        flats = scan.flats + (hit * rng.uniform(5_000, 40_000, hit.shape)).astype(np.uint16)
        read = scan.having(flats=flats).read()
        assert read.pixels.values_left_out == hit.sum()
        np.testing.assert_allclose(read.scan.line_integrals, scan.read().scan.line_integrals, atol=0.01)

    @pytest.mark.parametrize("state", [False, True])
    @pytest.mark.parametrize("value", [300, 9_000, 40_000])
    def test_stuck_columns_rows_and_pixels(self, state, value):
        scan = measured(3, state=state)
        images, flats = scan.images.copy(), scan.flats.copy()
        images[:, :, 20] = flats[:, :, 20] = value
        images[:, 11] = value
        images[:, 30, 30] = value
        valid = scan.having(images=images, flats=flats).read().scan.valid
        assert not valid[:, :, 20].any()
        assert not valid[:, 11].any()
        assert not valid[:, 30, 30].any()
        assert (~valid).sum() == len(images) * (48 + 40 - 1 + 1)

    @pytest.mark.parametrize("photons", [100, 1000, 20_000])
    @pytest.mark.parametrize("views", [2, 3])
    def test_equal_counts_by_chance_in_few_views_are_not_stuck(self, views, photons):
        scan = measured(8, state=True, photons=photons)
        images = scan.images[:views]
        images[1, 5, 5] = images[0, 5, 5]
        assert not stuck_pixels(images).any()

    def test_nan_in_counts_flats_and_darks_is_masked_and_counted(self):
        scan = measured(4)
        images, flats, darks = (stack.astype(np.float32) for stack in (scan.images, scan.flats, scan.darks))
        images[3, 5, 6], images[:, 8, 9], flats[2, 1, 1], flats[:, 2, 2], darks[:, 3, 3] = np.inf, *[np.nan] * 4
        read = scan.having(images=images, flats=flats, darks=darks).read()
        assert read.pixels.missing == 1 + 3 * 48
        assert (~read.scan.valid).sum() == 1 + 3 * 48
        assert read.scan.valid[:, 1, 1].all()
        assert np.isfinite(read.scan.line_integrals).all()

    def test_overexposed_camera_is_named(self):
        scan = measured(5)
        with pytest.raises(InputError, match="saturated at 65535; the camera was overexposed"):
            scan.having(images=(scan.images * 4.0).clip(0, 65535).astype(np.uint16)).having(
                flats=(scan.flats * 4.0).clip(0, 65535).astype(np.uint16)
            ).read()
