"""The table of ``motions.csv``: its columns, and motions to and from it.

In the table: mm and degrees, one row a grain; in `Motions`: mm and radians.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.described_table import Columns, described, frozen, vector_columns
from grainmotion.model.strain import STRAIN_NAMES

if TYPE_CHECKING:
    import pandas as pd

MOTION_COLUMNS = (
    "label", "status", "x", "y", "z", "ux", "uy", "uz", "wx", "wy", "wz",
    "sd_ux", "sd_uy", "sd_uz", "sd_wx", "sd_wy", "sd_wz", "residual", "iterations",
)  # fmt: skip
REASON_COLUMN = "reason"
"""Column of ``motions.csv`` after `MOTION_COLUMNS`; files of older versions lack it."""
OK_COLUMNS = ("ok_translation", "ok_rotation")
"""Columns of ``motions.csv`` after `REASON_COLUMN`; files of older versions lack them."""
STRAIN_COLUMNS = (*STRAIN_NAMES, *(f"sd_{name}" for name in STRAIN_NAMES))
"""Last columns of ``motions.csv``, where strains were measured."""
MOTIONS_CONTENT = "motions of the grains from the reference to one state"
MOTION_DESCRIPTIONS: Columns = frozen({
    "label": ("1", "of the grain in the reference volume"),
    "status": ("text", "outcome of the fit: converged, poorly-determined, ... (docs/conventions.md)"),
    **{axis: ("mm", f"centre of mass c in the reference, by attenuation, {axis}") for axis in "xyz"},
    **vector_columns("u", "mm", "translation of the centre"),
    **vector_columns("w", "deg", "rotation vector about the centre"),
    **vector_columns("sd_u", "mm", "standard deviation of the translation"),
    **vector_columns("sd_w", "deg", "standard deviation of the rotation, of an increment on the left"),
    "residual": ("1", "root mean square of measured - simulated line integrals over the footprint"),
    "iterations": ("1", "of the fit"),
    "reason": ("text", "cause and remedy where the grain did not converge"),
    "ok_translation": ("yes or no", "whether ux uy uz are a result to use"),
    "ok_rotation": ("yes or no", "whether wx wy wz are a result to use"),
    **{name: ("1", "Biot strain e = U - I of a strained grain, frame of the reference") for name in STRAIN_NAMES},
    **{f"sd_{name}": ("1", f"standard deviation of {name}") for name in STRAIN_NAMES},
})  # fmt: skip
"""Unit and meaning of each column."""


class MotionFields(TypedDict):
    """The fields of `Motions` that the table holds, under their names there; mm and radians."""

    labels: NDArray[np.int64]
    centers: NDArray[np.float64]
    translations: NDArray[np.float64]
    rotations: NDArray[np.float64]
    covariances: NDArray[np.float64]
    statuses: NDArray[np.str_]
    residuals: NDArray[np.float64]
    iterations: NDArray[np.int64]
    reasons: tuple[str, ...]
    ok_translation: NDArray[np.bool_]
    ok_rotation: NDArray[np.bool_]
    strains: NDArray[np.float64] | None
    strain_covariances: NDArray[np.float64] | None


def table_from_fields(fields: MotionFields) -> pd.DataFrame:
    """The table of ``motions.csv``, see `Motions.to_table`."""
    import pandas as pd  # takes half a second, which a fit does not need

    sd = _standard_deviations(fields["covariances"])
    sd[:, 3:] = np.rad2deg(sd[:, 3:])
    motion = [fields["centers"], fields["translations"], np.rad2deg(fields["rotations"]), sd]
    table = pd.DataFrame(np.concatenate(motion, axis=1), columns=list(MOTION_COLUMNS[2:17]))
    table.insert(0, "label", fields["labels"])
    table.insert(1, "status", fields["statuses"])
    table["residual"] = fields["residuals"]
    table["iterations"] = fields["iterations"]
    table[REASON_COLUMN] = [_plain_text(reason) for reason in fields["reasons"]]
    for name, flags in zip(OK_COLUMNS, (fields["ok_translation"], fields["ok_rotation"]), strict=True):
        table[name] = flags
    strains, strain_covariances = fields["strains"], fields["strain_covariances"]
    if strains is not None and strain_covariances is not None:
        table[list(STRAIN_COLUMNS)] = np.hstack([strains, _standard_deviations(strain_covariances)])
    return described(table, MOTION_DESCRIPTIONS, MOTIONS_CONTENT)


def fields_from_table(table: pd.DataFrame, where: str) -> MotionFields:
    """The fields of `Motions` in a table, see `Motions.from_table`; covariances get the variances alone."""
    missing = [c for c in MOTION_COLUMNS if c not in table.columns]
    if missing:
        raise InputError(where, f"columns {missing} are missing", f"give {','.join(MOTION_COLUMNS)}")
    sd = table[list(MOTION_COLUMNS[11:17])].to_numpy(float, copy=True)
    sd[:, 3:] = np.deg2rad(sd[:, 3:])
    strains = strain_sd = None
    if set(STRAIN_COLUMNS) <= set(table.columns):
        strains, strain_sd = np.hsplit(table[list(STRAIN_COLUMNS)].to_numpy(float), 2)
    return MotionFields(
        labels=table["label"].to_numpy(np.int64),
        centers=table[["x", "y", "z"]].to_numpy(float),
        translations=table[["ux", "uy", "uz"]].to_numpy(float),
        rotations=np.deg2rad(table[["wx", "wy", "wz"]].to_numpy(float)),
        covariances=sd[:, :, None] ** 2 * np.eye(6),
        statuses=table["status"].to_numpy(str).astype("<U20"),
        residuals=table["residual"].to_numpy(float),
        iterations=table["iterations"].to_numpy(np.int64),
        reasons=_reasons(table),
        ok_translation=_flags(table, "ok_translation"),
        ok_rotation=_flags(table, "ok_rotation"),
        strains=strains,
        strain_covariances=None if strain_sd is None else strain_sd[:, :, None] ** 2 * np.eye(6),
    )


def _standard_deviations(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of n six-parameter covariances ``(n, 6, 6)``, as ``(n, 6)``."""
    return np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))


def _plain_text(sentence: str) -> str:
    """A sentence in one line that no spreadsheet takes for a formula and no reader for a comment."""
    return " ".join(sentence.replace("#", "no. ").split()).lstrip("=+-@ ")


def _reasons(table: pd.DataFrame) -> tuple[str, ...]:
    if REASON_COLUMN not in table.columns:
        return ("",) * len(table)
    return tuple("" if reason != reason else str(reason) for reason in table[REASON_COLUMN])


def _flags(table: pd.DataFrame, name: str) -> NDArray[np.bool_]:
    """A column of `OK_COLUMNS`; empty if the table lacks it."""
    return table[name].to_numpy(bool) if name in table.columns else np.zeros(0, dtype=bool)
