"""Motions of the pieces of broken grains as ``pieces.csv``: one row a piece, mm and **degrees** as ``motions.csv``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from grainmotion.io.bodies_csv import RIGID_MOTION_COLUMNS, rigid_motion_numbers
from grainmotion.io.files import atomic_write
from grainmotion.model.state_fit import PieceMotion

if TYPE_CHECKING:
    import pandas as pd

PIECE_COLUMNS = ("label", "piece", "status", "share", *RIGID_MOTION_COLUMNS)


def piece_table(pieces: Sequence[PieceMotion]) -> pd.DataFrame:
    """The table of ``pieces.csv``: mm and degrees; the motion is about the piece's own centre x y z."""
    import pandas as pd  # takes half a second and 60 MB

    rows = [[piece.label, piece.piece, piece.status, piece.share, *rigid_motion_numbers(piece)] for piece in pieces]
    return pd.DataFrame(rows, columns=list(PIECE_COLUMNS))


def write_piece_motions(path: str | Path, pieces: Sequence[PieceMotion]) -> None:
    """Write the motions of the pieces of one state."""
    with atomic_write(path) as temporary:
        piece_table(pieces).to_csv(temporary, index=False, float_format="%.9g")
