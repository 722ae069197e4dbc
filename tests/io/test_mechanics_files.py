"""Files of mechanics, read by pandas and json alone."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from grainmotion.io.mechanics_files import mechanics_names, write_mechanics
from grainmotion.mechanics.columns import (
    BODY_CONTACT_COLUMNS,
    CONTACT_COLUMNS,
    STATE_CONTACT_COLUMNS,
    STRAIN_MAP_COLUMNS,
    VOID_COLUMNS,
)
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.mechanics.state_mechanics import reference_mechanics, state_mechanics
from grainmotion.model.volume import Volume
from spheres import known_motions, sphere_grains

GRID = Volume.zeros((40, 40, 40), 1.0)
CUBE = 5.0 * np.stack(np.meshgrid(*[[-1.0, 1]] * 3), axis=-1).reshape(-1, 3) * 1.0


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Eight spheres that touch, of which one is gone and one leaves to the right; compressed by 1 % along z."""
    folder = tmp_path_factory.mktemp("mechanics")
    grains = sphere_grains(CUBE, np.full(8, 5.0), GRID.shape, finer=1)
    shift = grains.centers * [0, 0, -0.01]
    leaving = int(np.argmax(grains.centers @ [1, 0.1, 0.2]))
    shift[leaving, 0] += 1.5
    statuses = ["converged"] * 8
    statuses[leaving - 1] = "absent"
    motions = known_motions(grains.centers, shift, sd=0.01, statuses=statuses)
    settings = MechanicsSettings(cells="radical")
    before = reference_mechanics(grains, GRID, settings)
    write_mechanics(folder, before, settings, prefix="reference_")
    write_mechanics(folder / "one", state_mechanics(grains, GRID, motions, before.contacts, settings), settings)
    return folder, leaving + 1


def test_names(written):
    folder, _ = written
    assert {p.name for p in (folder / "one").iterdir()} == set(mechanics_names(state=True))
    top = {p.name for p in folder.iterdir() if p.is_file()}
    assert top == set(mechanics_names("reference_", state=False))


def test_columns_are_as_described(written):
    folder, _ = written
    for name, columns in (
        ("one/strains.csv", STRAIN_MAP_COLUMNS),
        ("one/contacts.csv", STATE_CONTACT_COLUMNS),
        ("one/body_contacts.csv", BODY_CONTACT_COLUMNS),
        ("one/void_ratio.csv", VOID_COLUMNS),
        ("reference_contacts.csv", CONTACT_COLUMNS),
        ("reference_void_ratio.csv", VOID_COLUMNS),
    ):
        assert list(pd.read_csv(folder / name).columns) == list(columns)


def test_contacts_tell_what_became_of_them(written):
    folder, leaving = written
    reference, state = pd.read_csv(folder / "reference_contacts.csv"), pd.read_csv(folder / "one" / "contacts.csv")
    assert (reference["kind"] == "contact").sum() == 12
    assert list(reference["gap"].between(-0.2, 0.4)) == [True] * len(reference)
    along_x = reference[(reference["nx"].abs() > 0.9) & reference[["label_1", "label_2"]].eq(leaving).any(axis=1)]
    row = state.merge(along_x[["label_1", "label_2"]])
    assert row["change"].tolist() in (["lost"], ["unknown"])
    assert set(state["change"]) >= {"kept", "lost", "unknown"}
    assert state.loc[state["change"] == "unknown", "sliding"].isna().all()


def test_summary(written):
    folder, leaving = written
    found = json.loads((folder / "one" / "mechanics.json").read_text())
    assert found["strain"]["F"][2][2] == pytest.approx(0.99, abs=1e-6)
    assert found["changes"]["unknown"] == 3
    assert found["left_out"] == {str(leaving - 1): "translation not to use: absent"}
    assert found["settings"] == {"estimator": "cells", "reach": 2.0, "tolerance": 0.7, "cells": "radical"}
    assert {"grainmotion", "frame", "units"} <= set(found)
    assert found["fabric_of_branches"]["contacts"] == found["pairs"]["contact"]
    reference = json.loads((folder / "reference_mechanics.json").read_text())
    assert reference["pairs"]["contact"] == 12
    assert reference["fabric_of_normals"]["coordination"] == 3
    assert "strain" not in reference
