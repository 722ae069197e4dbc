"""`reference.h5` and `motions.h5`: round trips, units, and files of older versions."""

from dataclasses import replace

import example_motions
import h5py
import numpy as np
import pytest

from grainmotion.io.results import StoredReference, read_motions_h5, read_reference, write_motions_h5, write_reference
from grainmotion.model.detector_response import Response
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.scene import RIGID_MOTION, Body, Freedom, Scene
from grainmotion.model.state_fit import BodyMotion, NewGrain, PieceMotion, StateFit
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.phases import Phase


@pytest.fixture(name="motions")
def motions_() -> Motions:
    return example_motions.motions()


def assert_same_fit(one, other):
    for name in ("gain", "offset", "costs", "downweighted", "notes"):
        assert getattr(one, name) == getattr(other, name)
    assert len(one.bodies) == len(other.bodies)
    for body, same in zip(one.bodies, other.bodies, strict=True):
        for name in ("name", "kind", "freedom", "moved"):
            assert getattr(body, name) == getattr(same, name)
        for name in ("center", "translation", "rotation", "covariance"):
            np.testing.assert_array_equal(getattr(body, name), getattr(same, name))
    for name in ("view_corrections", "view_corrections_sd"):
        first, second = getattr(one, name), getattr(other, name)
        assert_same_array(first and first.columns, second and second.columns)
    assert (one.response is None) == (other.response is None)
    if one.response is not None:
        assert_same_array(one.response.polynomial, other.response.polynomial)
        assert_same_array(one.response.background, other.response.background)


def assert_same_array(one, other):
    assert (one is None) == (other is None)
    if one is not None:
        np.testing.assert_array_equal(one, other)


def two_bodies(rng):
    """One that moved, and one that did not."""
    moved = BodyMotion("upper piston", "piston", "free", *rng.normal(size=(3, 3)), rng.normal(size=(6, 6)), True)
    unknown = np.full((6, 6), np.nan)
    return moved, BodyMotion("wall", "wall", "z", np.ones(3), np.zeros(3), np.zeros(3), unknown, False)


class TestMotionsFile:
    def test_background_of_an_older_version_is_a_body(self, tmp_path, motions):
        write_motions_h5(tmp_path / "m.h5", motions)
        with h5py.File(tmp_path / "m.h5", "a") as file:
            file["fit/background"] = np.arange(6.0)
        fit = read_motions_h5(tmp_path / "m.h5").fit
        np.testing.assert_array_equal(fit.background, np.arange(6.0))
        assert fit.bodies[0].moved

    def test_round_trip(self, tmp_path, motions):
        write_motions_h5(tmp_path / "m.h5", motions)
        back = read_motions_h5(tmp_path / "m.h5")
        for name in (
            "labels",
            "centers",
            "translations",
            "rotations",
            "covariances",
            "residuals",
            "iterations",
        ):
            np.testing.assert_array_equal(getattr(back, name), getattr(motions, name))
        assert back.statuses.tolist() == motions.statuses.tolist()
        assert back.reasons == motions.reasons
        assert_same_fit(back.fit, motions.fit)

    def test_round_trip_of_a_full_fit(self, tmp_path, motions):
        rng = np.random.default_rng(4)
        fit = StateFit(
            1.02, 0.01, (("free", 0.1),), Response(rng.normal(size=(3, 2)), rng.normal(size=(3, 6))),
            ViewCorrections.of(rng.normal(size=(3, 3))), ViewCorrections.of(rng.uniform(size=(3, 3))),
            two_bodies(rng), 0.03, ("one; two", "µ"),
        )  # fmt: skip
        write_motions_h5(tmp_path / "m.h5", replace(motions, fit=fit))
        with h5py.File(tmp_path / "m.h5") as file:
            assert file["fit/corrections"].attrs["unit"] == "pixel, pixel, rad"
            np.testing.assert_array_equal(file["fit/corrections"][:, 2], fit.view_corrections.angles)
        assert_same_fit(read_motions_h5(tmp_path / "m.h5").fit, fit)

    def test_new_grains_and_pieces_come_back(self, tmp_path, motions):
        rng = np.random.default_rng(5)
        new = NewGrain(*rng.normal(size=(2, 3)), 0.8, 0.05, 0.11)
        piece = PieceMotion(3, 1, 0.6, *rng.normal(size=(3, 3)), rng.normal(size=(6, 6)), "converged")
        fit = StateFit(appeared=(new, replace(new, radius=0.7)), pieces=(piece, replace(piece, piece=2)))
        write_motions_h5(tmp_path / "m.h5", replace(motions, fit=fit))
        back = read_motions_h5(tmp_path / "m.h5").fit
        assert (len(back.appeared), len(back.pieces)) == (2, 2)
        for one, other in ((new, back.appeared[0]), (piece, back.pieces[0])):
            for name, value in vars(one).items():
                np.testing.assert_array_equal(getattr(other, name), value)

    def test_units_are_stored_as_attributes(self, tmp_path, motions):
        write_motions_h5(tmp_path / "m.h5", replace(motions, fit=StateFit(bodies=two_bodies(np.random.default_rng(0)))))
        with h5py.File(tmp_path / "m.h5") as file:
            assert file["translations"].attrs["unit"] == "mm"
            assert file["rotations"].attrs["unit"] == "rad"
            assert file["fit/bodies/rotation"].attrs["unit"] == "rad"

    def test_file_of_the_first_version_is_read(self, tmp_path, motions):
        write_motions_h5(tmp_path / "m.h5", motions)
        with h5py.File(tmp_path / "m.h5", "a") as file:
            del file["fit/notes"]
            del file["fit"].attrs["downweighted"]
            for name in ("translations", "rotations"):
                del file[name].attrs["unit"]
        back = read_motions_h5(tmp_path / "m.h5")
        np.testing.assert_array_equal(back.rotations, motions.rotations)
        assert_same_fit(back.fit, motions.fit)


class TestReferenceFile:
    def test_round_trip(self, tmp_path):
        volume = Volume(np.random.default_rng(0).uniform(size=(4, 5, 6)), 0.1, (1.0, 2.0, 3.0))
        labels = np.zeros((4, 5, 6), np.int32)
        labels[1:3, 1:3, 1:3] = 2
        phases = (Phase("air", 0.0, 0.75), Phase("grains", 0.7, 0.25))
        write_reference(tmp_path / "r.h5", StoredReference(volume, (0.3, 0.1), labels, 0.5, (2,), phases=phases))
        back = read_reference(tmp_path / "r.h5")
        np.testing.assert_array_equal(back.volume.array, volume.array)
        assert (back.volume.voxel_size, back.volume.center) == (0.1, (1.0, 2.0, 3.0))
        assert (back.residuals, back.threshold, back.border) == ((0.3, 0.1), 0.5, (2,))
        assert back.phases == phases
        np.testing.assert_array_equal(back.labels, labels)

    def test_scene(self, tmp_path):
        array = np.zeros((6, 5, 4))
        array[1:3, 1:3, 1:3], array[4:, :, 0], array[0, 3:, 1] = 1.0, 2.0, 3.0
        volume, labels = Volume(array, 0.1, (1.0, 2.0, 3.0)), (array == 1).astype(np.int32)
        bodies = [("upper piston", "piston", 2.0, RIGID_MOTION), ("wall", "wall", 3.0, Freedom.of("z wz"))]
        scene = Scene(tuple(Body(n, k, volume.cropped(array == mu), f) for n, k, mu, f in bodies))
        grains = GrainSet(grains_from_labels(volume, labels, reach=0, finer=1, background="ignore").grains, scene)
        write_reference(tmp_path / "r.h5", StoredReference(volume, (), labels), grains)
        back = read_reference(tmp_path / "r.h5").scene
        for one, other in zip(back.bodies, scene.bodies, strict=True):
            assert (one.name, one.kind, one.freedom) == (other.name, other.kind, other.freedom)
            np.testing.assert_array_equal(one.volume.array, other.volume.array)
            np.testing.assert_allclose(one.volume.center, other.volume.center)

    def test_file_of_an_older_version_has_no_scene(self, tmp_path):
        labels = np.ones((2, 2, 2), np.int32)
        write_reference(tmp_path / "r.h5", StoredReference(Volume(labels, 1.0), (), labels))
        assert read_reference(tmp_path / "r.h5").scene is None

    def test_volume_without_labels(self, tmp_path):
        write_reference(tmp_path / "r.h5", StoredReference(Volume.zeros((2, 2, 2), 1.0)))
        assert read_reference(tmp_path / "r.h5").labels is None


def test_strains_are_stored_where_they_were_measured(tmp_path):
    strained = example_motions.strained()
    write_motions_h5(tmp_path / "m.h5", strained)
    back = read_motions_h5(tmp_path / "m.h5")
    np.testing.assert_array_equal(back.strains, strained.strains)
    np.testing.assert_array_equal(back.strain_covariances, strained.strain_covariances)
    write_motions_h5(tmp_path / "rigid.h5", example_motions.motions())
    assert read_motions_h5(tmp_path / "rigid.h5").strains is None
