"""What other software made: a reference volume, and what of it its radiographs saw."""

from __future__ import annotations

import numpy as np
from experiment_inputs import inputs_of

from grainmotion.experiment.given_inputs import seen_given_volume
from tiny_experiment import TOML, write_tiny


def test_radiographs_tell_what_they_saw_of_a_given_volume(tmp_path):
    folder = write_tiny(tmp_path).parent
    np.save(folder / "volume.npy", np.ones((28, 36, 36), np.float32))
    both = TOML.replace("[reference]", '[reference]\nvolume = "volume.npy"')
    field = seen_given_volume(inputs_of(folder, both)).field
    assert field is not None
    assert field.holds_all
    alone = both.replace('radiographs = "reference/*.tif"', "").replace('geometry = "reference.csv"', "")
    assert seen_given_volume(inputs_of(folder, alone)).field is None
