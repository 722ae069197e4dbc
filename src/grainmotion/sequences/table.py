"""The table of a load series: one row a state and grain, in mm and degrees; its columns with units and meanings."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.model.motions import Motions

if TYPE_CHECKING:
    import pandas as pd

FRAME = (
    "sample frame, right-handed: z up along the rotation axis, origin on it; rotation vectors by the right-hand rule"
)
STATE_COLUMNS = {
    "state": ("", "name of the state"),
    "index": ("1", "number of the state in loading order; 1 is the first after the reference"),
    "time": ("s", "of the state, since the reference scan"),
}
"""Columns that are alike for all grains of a state: unit and meaning."""
MOTION_MEANINGS = {
    "status": ("", "outcome of the fit: converged, poorly-determined, ... (docs/conventions.md)"),
    "ok_translation": ("", "whether ux uy uz are a result to use"),
    "ok_rotation": ("", "whether wx wy wz are a result to use"),
    **{f"u{a}": ("mm", "translation of the centre from the reference") for a in "xyz"},
    **{f"w{a}": ("deg", "rotation vector from the reference, about the centre") for a in "xyz"},
    **{f"sd_u{a}": ("mm", f"standard deviation of u{a}") for a in "xyz"},
    **{f"sd_w{a}": ("deg", f"standard deviation of w{a}") for a in "xyz"},
    **{f"du{a}": ("mm", "translation of the centre from the state before") for a in "xyz"},
    **{f"dw{a}": ("deg", "rotation vector from the state before, about the centre in that state") for a in "xyz"},
    **{f"sd_du{a}": ("mm", f"standard deviation of du{a}, errors of the two states independent") for a in "xyz"},
    **{f"sd_dw{a}": ("deg", f"standard deviation of dw{a}, errors of the two states independent") for a in "xyz"},
    "path": ("mm", "length of the way of the centre from the reference, straight from state to state"),
    "rotation_path": ("deg", "sum of the angles of rotation from state to state"),
    "residual": ("1", "root mean square of measured - simulated line integrals over the footprint"),
    "iterations": ("1", "of the fit"),
    "reason": ("", "cause and remedy where the grain did not converge"),
}
"""Columns of a state and grain: unit and meaning."""
GRAIN_COLUMNS = {
    "label": ("1", "of the grain in the reference volume"),
    **{a: ("mm", "centre of mass in the reference") for a in "xyz"},
}
"""Columns that are alike in all states: unit and meaning."""
SERIES_COLUMNS = {**STATE_COLUMNS, **GRAIN_COLUMNS, **MOTION_MEANINGS}
"""All columns of the table in order: unit and meaning."""
SERIES_STRAINS = {
    **{f"e{ab}": ("1", "Biot strain from the reference") for ab in ("xx", "yy", "zz", "yz", "xz", "xy")},
    **{f"sd_e{ab}": ("1", f"standard deviation of e{ab}") for ab in ("xx", "yy", "zz", "yz", "xz", "xy")},
}
"""Further columns where strains were measured: unit and meaning."""


@dataclass(frozen=True, eq=False)
class SeriesFields:
    """What the table of a series is made of, as the attributes of `Series` of these names; mm and radians."""

    states: tuple[str, ...]
    times: NDArray[np.float64]
    motions: tuple[Motions, ...]
    increments: Float
    rotation_increments: Float
    increment_sd: Float
    paths: Float
    rotation_paths: Float


def series_table(fields: SeriesFields) -> pd.DataFrame:
    """The table, see `Series.to_table`."""
    import pandas as pd  # takes half a second, which a fit does not need

    tables = []
    for k, (name, motions) in enumerate(zip(fields.states, fields.motions, strict=True)):
        table = motions.to_table()
        table.insert(0, "state", name)
        table.insert(1, "index", k + 1)
        table.insert(2, "time", fields.times[k])
        columns = {"du": fields.increments[k], "dw": np.rad2deg(fields.rotation_increments[k])}
        columns |= {"sd_du": fields.increment_sd[k, :, :3], "sd_dw": np.rad2deg(fields.increment_sd[k, :, 3:])}
        for head, values in columns.items():
            table[[f"{head}{axis}" for axis in "xyz"]] = values
        table["path"], table["rotation_path"] = fields.paths[k], np.rad2deg(fields.rotation_paths[k])
        tables.append(table)
    whole = pd.concat(tables, ignore_index=True)
    strained = set(SERIES_STRAINS) <= set(whole.columns)
    meanings = {**SERIES_COLUMNS, **(SERIES_STRAINS if strained else {})}
    whole = whole[list(meanings)]
    whole.attrs.update(
        content="grainmotion load series",
        version=version("grainmotion"),
        frame=FRAME,
        units={name: unit for name, (unit, _) in meanings.items() if unit},
        meanings={name: meaning for name, (_, meaning) in meanings.items()},
    )
    return whole
