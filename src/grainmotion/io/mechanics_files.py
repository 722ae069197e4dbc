"""Files of the mechanics of a state, or of the reference.

``strains.csv``, ``contacts.csv``, ``body_contacts.csv``, ``void_ratio.csv`` and ``mechanics.json``.

The columns are those of `grainmotion.mechanics.columns`.  ``contacts.csv`` of a state joins what became of each pair
with its gap, place and directions in the state.  ``mechanics.json`` holds the sample as a whole, with units, frame,
version and settings.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

from grainmotion.io.contents import about
from grainmotion.io.files import atomic_write
from grainmotion.mechanics.columns import STATE_CONTACT_COLUMNS
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.mechanics.state_mechanics import StateMechanics

if TYPE_CHECKING:
    import pandas as pd

MECHANICS_UNITS = "mm, degrees, mm^3; strains, fabric and void ratios are numbers without a unit"


def mechanics_names(prefix: str = "", *, state: bool) -> tuple[str, ...]:
    """Names of the files, of a state or of the reference."""
    names = (
        "contacts.csv",
        "body_contacts.csv",
        "void_ratio.csv",
        "mechanics.json",
        *(("strains.csv",) if state else ()),
    )
    return tuple(prefix + name for name in names)


def write_mechanics(folder: Path, found: StateMechanics, settings: MechanicsSettings, *, prefix: str = "") -> None:
    """Write the files into a folder, their names after ``prefix``."""
    _write(folder / f"{prefix}contacts.csv", contact_table(found))
    _write(folder / f"{prefix}body_contacts.csv", found.bodies.to_dataframe())
    _write(folder / f"{prefix}void_ratio.csv", found.voids.to_dataframe())
    if found.strains is not None:
        _write(folder / f"{prefix}strains.csv", found.strains.to_dataframe())
    data = {**about(), "units": MECHANICS_UNITS, "settings": dataclasses.asdict(settings), **found.summary}
    with atomic_write(folder / f"{prefix}mechanics.json") as temporary:
        temporary.write_text(json.dumps(data, indent=1), encoding="utf-8")


def contact_table(found: StateMechanics) -> pd.DataFrame:
    """The table of ``contacts.csv``: of a state with the changes since the reference."""
    table = found.contacts.to_dataframe()
    if found.changes is None:
        return table
    joined = found.changes.to_dataframe().merge(table.drop(columns="gap"), on=["label_1", "label_2"], how="left")
    return joined[list(STATE_CONTACT_COLUMNS)]


def _write(path: Path, table: pd.DataFrame) -> None:
    with atomic_write(path) as temporary:
        table.to_csv(temporary, index=False, float_format="%.9g")
