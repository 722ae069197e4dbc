"""Motions of the pieces of broken grains as ``pieces.csv``: one row a piece, mm and **degrees** as ``motions.csv``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion.io.files import atomic_write
from grainmotion.model.state_fit import PieceMotion

if TYPE_CHECKING:
    import pandas as pd

PIECE_COLUMNS = (
    "label", "piece", "status", "share", "x", "y", "z", "ux", "uy", "uz", "wx", "wy", "wz",
    "sd_ux", "sd_uy", "sd_uz", "sd_wx", "sd_wy", "sd_wz",
)  # fmt: skip


def piece_table(pieces: Sequence[PieceMotion]) -> pd.DataFrame:
    """The table of ``pieces.csv``: mm and degrees; the motion is about the piece's own centre x y z."""
    import pandas as pd  # takes half a second and 60 MB

    rows = []
    for piece in pieces:
        sd = np.sqrt(np.diagonal(piece.covariance))
        numbers = [piece.center, piece.translation, np.rad2deg(piece.rotation), sd[:3], np.rad2deg(sd[3:])]
        rows.append([piece.label, piece.piece, piece.status, piece.share, *np.concatenate(numbers)])
    return pd.DataFrame(rows, columns=list(PIECE_COLUMNS))


def write_piece_motions(path: str | Path, pieces: Sequence[PieceMotion]) -> None:
    """Write the motions of the pieces of one state."""
    with atomic_write(path) as temporary:
        piece_table(pieces).to_csv(temporary, index=False, float_format="%.9g")
