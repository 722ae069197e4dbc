"""Every column of a table of mechanics has a unit and a meaning, in the order of its description."""

from __future__ import annotations

import numpy as np
import pytest

from grainmotion.mechanics import columns
from grainmotion.mechanics.body_contacts import body_contacts
from grainmotion.mechanics.contact_changes import contact_changes
from grainmotion.mechanics.contacts import contacts
from grainmotion.mechanics.strains import strains
from grainmotion.mechanics.void_ratio import void_ratio
from grainmotion.model.volume import Volume
from spheres import known_motions, sphere_grains


@pytest.fixture(scope="module")
def tables():
    grains = sphere_grains([[-5.0, 0, 0], [5, 0, 0]], [5, 5], (20, 20, 32), finer=1)
    motions = known_motions(grains.centers, np.zeros((2, 3)))
    before, after = contacts(grains), contacts(grains, motions)
    return (
        (strains(motions).to_dataframe(), columns.STRAIN_MAP_COLUMNS),
        (after.to_dataframe(), columns.CONTACT_COLUMNS),
        (contact_changes(before, after, motions).to_dataframe(), columns.CHANGE_COLUMNS),
        (body_contacts(grains).to_dataframe(), columns.BODY_CONTACT_COLUMNS),
        (void_ratio(grains, Volume.zeros((20, 20, 32), 1.0)).to_dataframe(), columns.VOID_COLUMNS),
        (motions.to_dataframe(), None),
    )


def test_all_columns_are_described(tables):
    for table, described in tables:
        assert described is None or list(table.columns) == list(described)
        assert set(table.attrs["units"]) == set(table.columns) == set(table.attrs["meanings"])
        assert all(table.attrs["units"].values())
        assert "sample frame" in table.attrs["frame"]
        assert table.attrs["version"]
        assert table.attrs["content"]
