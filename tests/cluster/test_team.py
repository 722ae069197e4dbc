"""A state worked out by blocks of grains: the same numbers, bit by bit, as by all grains at once."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from few_grains import PANEL, geometry, grain_set, motions, radiographs, small_motions
from grainmotion import motion
from grainmotion.cluster import blocks, shares
from grainmotion.cluster.crew import Team
from grainmotion.cluster.shelf import Shelf
from grainmotion.packed import PackedGrains, Pose, Surroundings, packed_body
from grainmotion.project import project
from grainmotion.track import PAPER, TrackSettings, track
from grainmotion.tracking.freedom import DRIFT, Freedom
from grainmotion.tracking.residual import StateProblem, Target
from grainmotion.tracking.surroundings import Loose
from grainmotion.volume import Volume
from inline_work import InlineWork


def single(volume):
    return None if volume is None else replace(volume, array=volume.array.astype(np.float32))


DOUBLE = grain_set()
GRAINS = replace(DOUBLE, grains=tuple(replace(g, volume=single(g.volume), fine=single(g.fine)) for g in DOUBLE.grains))
TRUTH = small_motions(GRAINS)
SCAN = radiographs(GRAINS, TRUTH)
PACKED = PackedGrains.of(GRAINS)
POSE = Pose(0.5 * TRUTH.translations, motion.exp(0.5 * TRUTH.rotations))
BODY = Volume(0.02 * np.pad(np.ones((30, 10, 10), np.float32), 4), 0.1, (2.0, 0.5, 0.0))


@pytest.fixture
def team(tmp_path):
    shelf = Shelf(tmp_path)
    with threadpool_limits(limits=1, user_api="blas"):  # as in `track`
        yield Team(InlineWork(), shelf)
    shelf.close()


def target(**changes):
    return replace(Target(SCAN, np.zeros((4, *PANEL), np.float32), "trilinear", 1.5, DRIFT), **changes)


WEIGHTS = np.random.default_rng(0).uniform(0.5, 1.5, (4, *PANEL))
MASK = np.random.default_rng(1).random((4, *PANEL)) > 0.1
CASES = {
    "plain": {"freedom": Freedom()},
    "drift": {},
    "no filter": {"sigma": 0.0},
    "weights": {"weights": WEIGHTS},
    "masked": {"scan": replace(SCAN, valid=MASK)},
    "hardening": {"freedom": Freedom("view", "linear", 2)},
    "differences": {"derivatives": "differences"},
    "exact": {"projector": "exact"},
    "views": {"loose": Loose(views=True)},
    "background": {"fixed": project(BODY, SCAN.geometry), "body": packed_body(BODY), "loose": Loose(True, True)},
}
AROUND = Surroundings(np.tile([0.2, -0.1, 0.002], (4, 1)), np.array([0.02, 0.0, -0.01]), motion.exp([[0, 0, 0.01]])[0])


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
class TestOneEvaluation:
    def test_normal_equations(self, team, case):
        pose = replace(POSE, surroundings=AROUND) if "loose" in case else POSE
        one, many = (StateProblem(PACKED, t).linearize(pose) for t in (target(**case), target(**case, crew=team)))
        assert one.cost == many.cost > 0
        for name in ("gradient", "border", "corner", "slope"):
            np.testing.assert_array_equal(getattr(many, name), getattr(one, name))
            assert getattr(one, name).any() or name == "slope" or case.get("freedom") == Freedom()
        np.testing.assert_array_equal(many.hessian.toarray(), one.hessian.toarray())
        assert "lend" in team.work.done

    def test_what_is_seen(self, team, case):
        pose = replace(POSE, surroundings=AROUND) if "loose" in case else POSE
        one, many = (StateProblem(PACKED, t).look(pose) for t in (target(**case), target(**case, crew=team)))
        for name in ("residual", "simulated", "path", "raw", "factor"):
            np.testing.assert_array_equal(getattr(many, name), getattr(one, name))
        np.testing.assert_array_equal(many.cast.border(many.columns), one.cast.border(one.columns))
        np.testing.assert_array_equal(many.cast.normal_matrix().toarray(), one.cast.normal_matrix().toarray())
        again = [seen.cast.refiltered(seen.factor, target(**case).kernel) for seen in (one, many)]
        np.testing.assert_array_equal(again[1].normal_matrix().toarray(), again[0].normal_matrix().toarray())
        np.testing.assert_array_equal(again[1].border(one.columns), again[0].border(one.columns))


class TestTracking:
    @pytest.mark.parametrize(
        "settings",
        [TrackSettings(), replace(PAPER, iterations=2), TrackSettings(weights="photons", view_corrections="always")],
        ids=["default", "paper", "weights and poses of views"],
    )
    def test_same_motions(self, team, settings):
        one, many = (track(GRAINS, SCAN, settings=settings, **how) for how in ({}, {"crew": team}))
        for name in ("translations", "rotations", "covariances", "statuses", "residuals", "iterations"):
            np.testing.assert_array_equal(getattr(many, name), getattr(one, name))
        assert many.fit.costs == one.fit.costs

    def test_double_precision(self, team):
        one, many = (track(DOUBLE, SCAN, **how) for how in ({}, {"crew": team}))
        np.testing.assert_allclose(many.translations, one.translations, rtol=0, atol=1e-8)
        np.testing.assert_allclose(many.rotations, one.rotations, rtol=0, atol=1e-8)

    def test_a_grain_that_no_view_sees(self, team):
        start = motions(GRAINS, [[0, 0, 50.0], *TRUTH.translations[1:]])
        settings = TrackSettings(search=False, fields=False)
        one, many = (track(GRAINS, SCAN, start, settings, **how) for how in ({}, {"crew": team}))
        np.testing.assert_array_equal(many.translations, one.translations)
        assert one.statuses[0] == many.statuses[0] == "not-fitted"

    def test_wrong_guess_of_who_overlaps(self, team, monkeypatch):
        """Workers know whose patches overlap; a guess that left somebody out is not believed."""
        right = StateProblem(PACKED, target()).linearize(POSE).hessian.toarray()
        guess = {k: (1000 * k, 1000 * k + 1) for k in range(5)}
        monkeypatch.setattr("grainmotion.cluster.crew.guessed_rows", lambda *_: guess)
        found = StateProblem(PACKED, target(crew=team)).linearize(POSE).hessian.toarray()
        np.testing.assert_array_equal(found, right)

    def test_many_blocks_get_their_rows_only(self, team, monkeypatch):
        right = StateProblem(PACKED, target()).linearize(POSE)
        monkeypatch.setattr("grainmotion.cluster.crew.FEW", 0)
        monkeypatch.setattr("grainmotion.cluster.crew.AT_ONCE", 2)
        monkeypatch.setattr("grainmotion.cluster.blocks.FEWEST", 1)
        found = StateProblem(PACKED, target(crew=team)).linearize(POSE)
        assert team.work.done.count("unpack") == 4
        assert "merge" in team.work.done
        np.testing.assert_array_equal(found.gradient, right.gradient)
        np.testing.assert_array_equal(found.hessian.toarray(), right.hessian.toarray())


class TestBlocks:
    def test_every_grain_is_in_one(self):
        for n, count in ((1, 1), (2, 2), (15, 2), (100, 17), (400, 40)):
            rows = blocks.block_rows(PACKED.select(np.resize(np.arange(5), n)))
            np.testing.assert_array_equal(np.sort(np.concatenate(rows)), np.arange(n))
            assert len(rows) == count

    def test_about_equal_in_work(self):
        rows = blocks.block_rows(PACKED.select(np.resize(np.arange(5), 400)))
        work = [float((PACKED.radii[r % 5] ** 3).sum()) for r in rows]
        assert max(work) < 1.35 * np.mean(work)

    def test_a_block_holds_its_own_voxels_alone(self):
        block = blocks.cut(PACKED, np.array([3, 1]))
        assert len(block.grains.images) == PACKED.shapes[[1, 3]].prod(axis=1).sum()
        start = PACKED.starts[1]
        size = PACKED.shapes[1].prod()
        np.testing.assert_array_equal(block.grains.images[-size:], PACKED.images[start : start + size])

    def test_guess_holds_the_patches(self):
        walk = target().walk(POSE)
        rows = blocks.block_rows(PACKED)
        guess = blocks.guessed_rows(PACKED, POSE, walk.geometry, walk.margin, rows)
        for k, r in enumerate(rows):
            boxes = shares.cast_block(blocks.cut(PACKED, r).grains, blocks.posed(POSE, r), walk).patches.boxes
            assert guess[k][0] <= boxes[:, 2].min()
            assert guess[k][1] >= boxes[:, 3].max()


def test_empty_block(tmp_path):
    """A block that no view sees adds nothing, and asks for nothing."""
    away = Pose(POSE.translations + np.array([0, 0, 100]), POSE.matrices)
    cast = shares.cast_block(PACKED, away, target().walk(away))
    part = shares.add_up(cast, 0, 4, geometry().shape, False)
    assert part.sums.size == 0
    whole = shares.compare_and_pack(target(), part, pose=away)
    own = shares.share(cast, shares.unpack(whole, 0), 0, np.arange(5), target().kernel)
    assert not shares.equations(own, []).border.any()
