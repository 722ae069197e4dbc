"""The paper's planar studies at reduced size: one or two samples each, and ten where time does not matter."""

import numpy as np
import pytest
from validation.paper import figure4, images, table1, table2

some_seeds = pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 10), marks=pytest.mark.slow)])


class TestImages:
    @pytest.mark.parametrize("seed", [0, 7])
    def test_thirty_grains_that_do_not_touch(self, seed):
        sample = images.draw(seed)
        assert len(sample.grains()) == 30
        for label in range(1, 31):
            own = sample.labels == label
            around = np.zeros_like(own)
            for row in (-2, 0, 2):
                for column in (-2, 0, 2):
                    around |= np.roll(own, (row, column), (0, 1))
            assert set(np.unique(sample.labels[around])) == {0, label}

    def test_sizes_and_distances_of_the_sets(self):
        sample = images.draw(1)
        assert [len(sample.members(s)) for s in images.SETS] == [1, 6, 6, 30]
        nearest = {}
        for which in ("loose", "dense"):
            places = sample.grains(which).centers
            apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e9 * np.eye(6)
            nearest[which] = apart.min(axis=1).mean() / images.DIAMETER
        assert nearest["dense"] < 1.5 < nearest["loose"] < 2.7

    def test_the_same_seed_gives_the_same_sample(self):
        np.testing.assert_array_equal(images.draw(2).attenuation, images.draw(2).attenuation)
        assert not np.array_equal(images.draw(2).labels, images.draw(3).labels)


@some_seeds
def test_table_1_is_exact(seeds):
    """Every set of every sample is exact, in no more iterations than the paper's 8 to 12."""
    trials = [t for seed in seeds for t in table1.trial(seed)]
    assert all(t.exact for t in trials)
    for which in images.SETS:
        assert np.mean([t.iterations for t in trials if t.which == which]) <= 8


@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 10), marks=pytest.mark.slow)])
def test_table_2_is_exact_and_never_wrong_yet_converged(seeds):
    """Exact with 6, 4 and 2 views; no wrong grain is converged."""
    trials = [t for seed in seeds for t in table2.trial(seed)]
    exact = {views: sum(t.exact == 30 for t in trials if t.views == views) for views in table2.VIEWS}
    assert exact == dict.fromkeys(table2.VIEWS, len(seeds))
    assert sum(t.wrong for t in trials) == 0


@pytest.mark.parametrize(
    ("seeds", "rotations_deg", "directions_deg", "fewest"),
    [
        (range(1), [80.0], [135.0], 1),
        pytest.param(range(10), [-90.0, -60.0, 45.0, 80.0], [0.0, 135.0], 7, marks=pytest.mark.slow),
    ],
)
def test_figure_4_needs_the_search(seeds, rotations_deg, directions_deg, fewest):
    """From every start within ±90° and a diameter, where the solver without the search fails."""
    trials = [figure4.trial(seed, np.array(rotations_deg), np.array(directions_deg)) for seed in seeds]
    distinct = [t for t in trials if not t.symmetric]
    assert len(distinct) >= fewest
    assert all(t.rotated["with search"].all() for t in distinct)
    assert all(t.shifted["with search"].all() for t in trials)
    assert not all(t.rotated["plain"].all() for t in trials)
