"""Motions of bodies beside the grains as ``bodies.csv``: one row a body, mm and **degrees** as ``motions.csv``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainmotion.io.files import atomic_write
from grainmotion.model.state_fit import BodyMotion

if TYPE_CHECKING:
    import pandas as pd

BODY_COLUMNS = (
    "name", "kind", "freedom", "moved", "x", "y", "z", "ux", "uy", "uz", "wx", "wy", "wz",
    "sd_ux", "sd_uy", "sd_uz", "sd_wx", "sd_wy", "sd_wz",
)  # fmt: skip


def body_table(bodies: Sequence[BodyMotion]) -> pd.DataFrame:
    """The table of ``bodies.csv``: mm and degrees; standard deviations are empty for a body that did not move."""
    import pandas as pd  # takes half a second and 60 MB

    rows = []
    for body in bodies:
        sd = np.sqrt(np.diagonal(body.covariance))
        numbers = [body.center, body.translation, np.rad2deg(body.rotation), sd[:3], np.rad2deg(sd[3:])]
        rows.append([body.name, body.kind, body.freedom, body.moved, *np.concatenate(numbers)])
    return pd.DataFrame(rows, columns=list(BODY_COLUMNS))


def write_body_motions(path: str | Path, bodies: Sequence[BodyMotion]) -> None:
    """Write the motions of the bodies of one state."""
    with atomic_write(path) as temporary:
        body_table(bodies).to_csv(temporary, index=False, float_format="%.9g")
