"""Motions of bodies beside the grains as ``bodies.csv``: one row a body, mm and **degrees** as ``motions.csv``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._typing import Float
from grainmotion.io.files import atomic_write
from grainmotion.model.state_fit import BodyMotion, PieceMotion

if TYPE_CHECKING:
    import pandas as pd

RIGID_MOTION_COLUMNS = (
    "x", "y", "z", "ux", "uy", "uz", "wx", "wy", "wz", "sd_ux", "sd_uy", "sd_uz", "sd_wx", "sd_wy", "sd_wz",
)  # fmt: skip
"""Centre, motion and its standard deviations, mm and degrees, of a body or of a piece of a grain."""
BODY_COLUMNS = ("name", "kind", "freedom", "moved", *RIGID_MOTION_COLUMNS)


def rigid_motion_numbers(motion: BodyMotion | PieceMotion) -> Float:
    """The numbers of `RIGID_MOTION_COLUMNS`."""
    sd = np.sqrt(np.diagonal(motion.covariance))
    return np.concatenate([motion.center, motion.translation, np.rad2deg(motion.rotation), sd[:3], np.rad2deg(sd[3:])])


def body_table(bodies: Sequence[BodyMotion]) -> pd.DataFrame:
    """The table of ``bodies.csv``: mm and degrees; standard deviations are empty for a body that did not move."""
    import pandas as pd  # takes half a second and 60 MB

    rows = [[body.name, body.kind, body.freedom, body.moved, *rigid_motion_numbers(body)] for body in bodies]
    return pd.DataFrame(rows, columns=list(BODY_COLUMNS))


def write_body_motions(path: str | Path, bodies: Sequence[BodyMotion]) -> None:
    """Write the motions of the bodies of one state."""
    with atomic_write(path) as temporary:
        body_table(bodies).to_csv(temporary, index=False, float_format="%.9g")
