"""bodies.csv (`io.bodies_csv`)."""

import numpy as np
import pandas as pd

from grainmotion.io.bodies_csv import BODY_COLUMNS, write_body_motions
from grainmotion.model.state_fit import BodyMotion


def test_columns_are_in_mm_and_degrees(tmp_path):
    covariance = np.diag([0.01, 0.02, 0.03, *np.deg2rad([0.1, 0.2, 0.3])]) ** 2
    turn = np.deg2rad([1.0, 2.0, 3.0])
    moved = BodyMotion("ram", "piston", "free", np.arange(3.0), np.array([0.1, 0.2, 0.3]), turn, covariance, True)
    still = BodyMotion("wall", "wall", "z", np.ones(3), np.zeros(3), np.zeros(3), np.full((6, 6), np.nan), False)
    write_body_motions(tmp_path / "bodies.csv", (moved, still))
    table = pd.read_csv(tmp_path / "bodies.csv")
    assert tuple(table.columns) == BODY_COLUMNS
    np.testing.assert_allclose(table.loc[0, ["wx", "wy", "wz"]].to_numpy(float), [1, 2, 3])
    np.testing.assert_allclose(table.loc[0, ["sd_ux", "sd_uz", "sd_wz"]].to_numpy(float), [0.01, 0.03, 0.3])
    assert table["moved"].tolist() == [True, False]
    assert table.loc[1, "sd_ux":].isna().all()
