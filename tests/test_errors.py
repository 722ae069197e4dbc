"""Errors: their base classes, how settings report a wrong value, and pickling."""

import pickle

import pytest

import grainmotion as gm


@pytest.mark.parametrize(("kind", "builtin"), [(gm.InputError, ValueError), (gm.BackendError, RuntimeError)])
def test_errors_are_builtin_errors_too_and_keep_their_parts_when_pickled(kind, builtin):
    error = pickle.loads(pickle.dumps(kind("here", "fact", "remedy")))
    assert isinstance(error, builtin)
    assert isinstance(error, gm.GrainmotionError)
    assert (str(error), error.where, error.remedy) == ("here: fact; remedy", "here", "remedy")


@pytest.mark.parametrize(
    ("record", "wrong", "where"),
    [
        (gm.TrackSettings, {"filters": ()}, "TrackSettings.filters"),
        (gm.TrackSettings, {"filtres": (1.0,)}, "TrackSettings.filtres"),
        (gm.ReconstructSettings, {"sweeps": 0}, "ReconstructSettings.sweeps"),
        (gm.ReconstructSettings, {"sweeps": 2, "method": "accelerated"}, "ReconstructSettings"),
        (gm.SegmentSettings, {"depth": -1}, "SegmentSettings.depth"),
        (gm.PlanSettings, {"photons": 0}, "PlanSettings.photons"),
        (gm.CalibrateSettings, {"parameters": ("sideways",)}, "CalibrateSettings.parameters"),
        (gm.HardeningSettings, {"degree": 9}, "HardeningSettings.degree"),
    ],
)
def test_a_wrong_setting_is_named(record, wrong, where):
    with pytest.raises(gm.InputError) as raised:
        record(**wrong)
    assert raised.value.where == where


def test_a_wrong_positional_setting_is_named():
    with pytest.raises(gm.InputError, match=r"ReconstructSettings\.projector: .*got 'wavy'"):
        gm.ReconstructSettings("wavy")


def test_a_record_s_own_message_is_kept():
    with pytest.raises(gm.InputError, match="the first must be 1"):
        gm.Hardening((2.0,))
