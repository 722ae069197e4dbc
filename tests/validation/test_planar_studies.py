"""The paper's planar studies at reduced size: four samples each, and six more where time does not matter."""

import numpy as np
import pytest
from validation.paper import figure4, images, table1, table2

some_seeds = pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 10), marks=pytest.mark.slow)])


class TestImages:
    @pytest.mark.parametrize("seed", [0, 7])
    def test_thirty_grains_that_do_not_touch(self, seed):
        sample = images.draw(seed)
        assert len(sample.grains()) == 30
        for label in range(1, 31):
            mine = sample.labels == label
            around = np.zeros_like(mine)
            for row in (-2, 0, 2):
                for column in (-2, 0, 2):
                    around |= np.roll(mine, (row, column), (0, 1))
            assert set(np.unique(sample.labels[around])) == {0, label}

    def test_sets(self):
        sample = images.draw(1)
        assert [len(sample.members(s)) for s in images.SETS] == [1, 6, 6, 30]
        nearest = {}
        for which in ("loose", "dense"):
            places = sample.grains(which).centers
            apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e9 * np.eye(6)
            nearest[which] = apart.min(axis=1).mean() / images.DIAMETER
        assert nearest["dense"] < 1.5 < nearest["loose"] < 2.7

    def test_a_seed_is_a_sample(self):
        np.testing.assert_array_equal(images.draw(2).attenuation, images.draw(2).attenuation)
        assert not np.array_equal(images.draw(2).labels, images.draw(3).labels)


@some_seeds
def test_table_1(seeds):
    """Every set of every sample is exact, in no more iterations than the paper's 8 to 12."""
    trials = [t for seed in seeds for t in table1.trial(seed)]
    assert all(t.exact for t in trials)
    for which in images.SETS:
        assert np.mean([t.iterations for t in trials if t.which == which]) <= 8


@some_seeds
def test_table_2(seeds):
    """Exact with 6, 4 and 2 views, and never wrong yet converged."""
    trials = [t for seed in seeds for t in table2.trial(seed)]
    exact = {views: sum(t.exact == 30 for t in trials if t.views == views) for views in table2.VIEWS}
    assert exact == dict.fromkeys(table2.VIEWS, len(seeds))
    assert sum(t.wrong for t in trials) == 0


@pytest.mark.parametrize(("seeds", "fewest"), [(range(4), 2), pytest.param(range(10), 7, marks=pytest.mark.slow)])
def test_figure_4(seeds, fewest):
    """From every start in ±90° and up to a diameter away, where the plain solver loses its way."""
    trials = [figure4.trial(seed, np.array([-90.0, -60.0, 45.0, 80.0]), np.array([0.0, 135.0])) for seed in seeds]
    distinct = [t for t in trials if not t.symmetric]
    assert len(distinct) >= fewest
    assert all(t.rotated["with search"].all() for t in distinct)
    assert all(t.shifted["with search"].all() for t in trials)
    assert not all(t.rotated["plain"].all() for t in trials)
