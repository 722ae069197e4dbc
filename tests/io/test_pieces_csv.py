"""pieces.csv (`io.pieces_csv`)."""

import numpy as np
import pandas as pd

from grainmotion.io.pieces_csv import PIECE_COLUMNS, write_piece_motions
from grainmotion.model.state_fit import PieceMotion


def test_one_row_a_piece_in_mm_and_degrees(tmp_path):
    covariance = np.diag([0.01, 0.01, 0.02, *np.deg2rad([0.1, 0.2, 0.3])]) ** 2
    turn = np.deg2rad([1.0, 2.0, 3.0])
    piece = PieceMotion(7, 1, 0.55, np.arange(3.0), np.array([0.1, 0.2, 0.3]), turn, covariance, "converged")
    write_piece_motions(tmp_path / "pieces.csv", [piece])
    table = pd.read_csv(tmp_path / "pieces.csv")
    assert tuple(table.columns) == PIECE_COLUMNS
    assert table.iloc[0][["label", "piece", "status"]].tolist() == [7, 1, "converged"]
    np.testing.assert_allclose(table.iloc[0, 3:].astype(float)[:10], [0.55, 0, 1, 2, 0.1, 0.2, 0.3, 1, 2, 3])
    np.testing.assert_allclose(table.iloc[0, 13:].astype(float), [0.01, 0.01, 0.02, 0.1, 0.2, 0.3])
