"""Reading and writing calibration.json."""

import json
import math

import numpy as np
import pytest

from grainmotion.calibration.corrections import Calibration, Correction
from grainmotion.errors import InputError
from grainmotion.io.calibration_json import read_calibration, write_calibration
from grainmotion.model.geometry import Geometry
from grainmotion.preprocessing.beam_hardening import Hardening

NOMINAL = Geometry.cone([0, 90], (4, 6), 0.5, source_to_axis=20, source_to_detector=50)
CORRECTIONS = (
    Correction("shift_u", 0.123456789, 0.01),
    Correction("turn", float(np.deg2rad(0.25)), float(np.deg2rad(0.01))),
    Correction("pitch", 0.0, math.inf),
)
ESTIMATED = Calibration.of(NOMINAL, CORRECTIONS, (0.05, 0.03))
CURVE = Hardening((1.0, 0.1, 0.0), 2.5, 0.003)


@pytest.mark.parametrize("curve", [CURVE, None])
@pytest.mark.parametrize("estimated", [ESTIMATED, None])
def test_calibration_round_trip(tmp_path, estimated, curve):
    path = tmp_path / "calibration.json"
    write_calibration(path, estimated, curve)
    if estimated is not None:
        rows = json.loads(path.read_text())["geometry"]["corrections"]
        assert rows[1] == {"name": "turn", "value": 0.25, "sd": 0.01, "unit": "degrees"}
    calibration, hardening = read_calibration(path, NOMINAL)
    assert hardening == curve
    assert (calibration is None) == (estimated is None)
    if calibration is not None:
        assert calibration.corrections == CORRECTIONS
        assert calibration.residuals == ESTIMATED.residuals
        np.testing.assert_array_equal(calibration.geometry.vectors, ESTIMATED.geometry.vectors)


@pytest.mark.parametrize("text", ["{", "{}", '{"geometry": {}, "hardening": null}', "[1]"])
def test_files_without_a_calibration_are_refused(tmp_path, text):
    path = tmp_path / "calibration.json"
    path.write_text(text)
    with pytest.raises(InputError, match="holds no calibration"):
        read_calibration(path, NOMINAL)
