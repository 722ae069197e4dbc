"""appeared.csv (`io.appeared_csv`)."""

import numpy as np
import pandas as pd

from grainmotion.io.appeared_csv import APPEARED_COLUMNS, write_new_grains
from grainmotion.model.state_fit import NewGrain


def test_one_row_a_grain_in_mm(tmp_path):
    write_new_grains(tmp_path / "appeared.csv", [NewGrain(np.arange(3.0), np.full(3, 0.02), 0.9, 0.03, 0.1)])
    table = pd.read_csv(tmp_path / "appeared.csv")
    assert tuple(table.columns) == APPEARED_COLUMNS
    np.testing.assert_allclose(table.iloc[0], [1, 0, 1, 2, 0.02, 0.02, 0.02, 0.9, 0.03, 0.1])
