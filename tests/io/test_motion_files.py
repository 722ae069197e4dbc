"""Motions from Python to a file and back: a table, or HDF5 with covariances and the fit."""

import numpy as np
import pytest
from example_motions import motions, strained

import grainmotion as gm
from grainmotion.errors import InputError


@pytest.mark.parametrize("made", [motions, strained])
def test_hdf5_holds_everything(tmp_path, made):
    gm.write_motions(tmp_path / "m.h5", made())
    back = gm.read_motions(tmp_path / "m.h5")
    np.testing.assert_array_equal(back.covariances, made().covariances)
    np.testing.assert_array_equal(back.rotations, made().rotations)
    assert back.reasons == made().reasons
    assert back.fit.costs == made().fit.costs
    if made().strains is not None:
        np.testing.assert_array_equal(back.strains, made().strains)


def test_a_table_holds_standard_deviations(tmp_path):
    gm.write_motions(tmp_path / "m.csv", motions())
    back = gm.read_motions(tmp_path / "m.csv")
    np.testing.assert_allclose(back.rotations, motions().rotations, atol=1e-12)
    np.testing.assert_allclose(
        np.diagonal(back.covariances, axis1=1, axis2=2), np.diagonal(motions().covariances, axis1=1, axis2=2), rtol=1e-9
    )
    assert not back.fit.costs


def test_other_formats_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"use \.csv"):
        gm.write_motions(tmp_path / "m.xlsx", motions())
    (tmp_path / "broken.h5").write_text("no HDF5")
    with pytest.raises(InputError, match=r"broken\.h5"):
        gm.read_motions(tmp_path / "broken.h5")
