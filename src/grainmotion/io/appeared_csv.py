"""Grains of a state that the reference does not have as ``appeared.csv``: one row a grain, mm."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from grainmotion.io.files import atomic_write
from grainmotion.model.state_fit import NewGrain

if TYPE_CHECKING:
    import pandas as pd

APPEARED_COLUMNS = ("number", "x", "y", "z", "sd_x", "sd_y", "sd_z", "radius", "sd_radius", "attenuation")


def appeared_table(grains: Sequence[NewGrain]) -> pd.DataFrame:
    """The table of ``appeared.csv``: mm, and 1/mm."""
    import pandas as pd  # takes half a second and 60 MB

    rows = [
        [number, *grain.center, *grain.center_sd, grain.radius, grain.radius_sd, grain.attenuation]
        for number, grain in enumerate(grains, start=1)
    ]
    return pd.DataFrame(rows, columns=list(APPEARED_COLUMNS))


def write_new_grains(path: str | Path, grains: Sequence[NewGrain]) -> None:
    """Write the grains that appeared in one state."""
    with atomic_write(path) as temporary:
        appeared_table(grains).to_csv(temporary, index=False, float_format="%.9g")
