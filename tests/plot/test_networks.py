"""The network of contacts: lines between centres, a style for each kind of pair."""

import numpy as np
import pytest
from drawn_grains import PLACES, moved
from matplotlib.collections import LineCollection

from grainmotion import plot
from grainmotion.errors import InputError
from known_contacts import contacts_along


def two_pairs(second: int):
    """Grains 3 and 5 touch, 3 and another are open."""
    kinds = np.array(["contact", "open"], dtype="<U13")
    return contacts_along(np.eye(3)[[0, 2]], [[3, 5], [3, second]], 4, kinds=kinds, points=PLACES[[1, 2]] / 2)


def test_lines_join_the_centres_of_each_pair_by_kind():
    ax = plot.contact_network(two_pairs(7), moved(), plane="xz")
    touching, apart = (c for c in ax.collections if isinstance(c, LineCollection))
    centers = (PLACES + moved().translations)[:, [0, 2]]
    assert touching.get_segments()[0] == pytest.approx(centers[[0, 1]])
    assert apart.get_segments()[0] == pytest.approx(centers[[0, 2]])
    assert (touching.get_label(), apart.get_label()) == ("1 contact", "1 open")


def test_places_of_contacts_are_marked():
    places = plot.contact_network(two_pairs(7), moved()).lines[0].get_xydata()
    assert places == pytest.approx(PLACES[[1]][:, [0, 2]] / 2)


def test_no_pair_is_no_line_and_unknown_grains_are_named():
    nobody = contacts_along(np.zeros((0, 3)), [], 4)
    assert not plot.contact_network(nobody, moved()).collections
    with pytest.raises(InputError, match="no grain 8"):
        plot.contact_network(two_pairs(8), moved())
