"""What the page tabulates, plots and colours grains by: columns of ``motions.csv`` and what follows from them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from grainmotion.model.strain import STRAIN_NAMES

MOTION_NAMES = ("ux", "uy", "uz", "wx", "wy", "wz")
SD_NAMES = tuple(f"sd_{name}" for name in MOTION_NAMES)

Kind = Literal["sequential", "diverging", "categorical"]
How = Literal["", "norm", "norm_less_mean", "rms", "sum"]


@dataclass(frozen=True)
class Quantity:
    """One number a grain and state.

    ``of`` and ``how`` tell how it follows from other columns: the length of a vector, its length after its mean over
    the grains is taken off, the root mean square or the sum of components.  Columns of the page have no ``of``.
    ``digits`` is "length", "angle", "strain" (fixed decimals) or "significant"; ``note`` says below the colour bar what
    is measured.
    """

    key: str
    title: str
    symbol: str
    unit: str
    kind: Kind
    group: str
    digits: str = "significant"
    of: tuple[str, ...] = ()
    how: How = ""
    note: str = ""


_U, _W, _SD, _E = "Translation", "Rotation", "Standard deviation", "Strain"
_COMPONENTS_NOTE = "Root mean square over the three components."
_BIOT_NOTE = "Biot's strain U − I in the frame of the reference: "
_RESIDUAL_MEANING = "Root mean square of measured minus simulated line integrals behind the grain."
_VOLUME_NOTE = _BIOT_NOTE + "its trace, about the relative change of volume."


def _strain_note(name: str) -> str:
    length = name[1] == name[2]
    return _BIOT_NOTE + ("relative change of length, positive is longer." if length else "half of the change of angle.")


QUANTITIES = (
    Quantity("status", "Status", "", "", "categorical", "Fit"),
    Quantity("u", "Displacement", "|u|", "mm", "sequential", _U, "length", ("ux", "uy", "uz"), "norm"),
    Quantity(
        "u_less_mean", "Displacement less its mean", "|u − ū|", "mm", "sequential", _U, "length", ("ux", "uy", "uz"),
        "norm_less_mean",
    ),
    *(Quantity(f"u{a}", f"Displacement along {a}", f"u{a}", "mm", "diverging", _U, "length") for a in "xyz"),
    Quantity("w", "Rotation angle", "|ω|", "°", "sequential", _W, "angle", ("wx", "wy", "wz"), "norm"),
    *(Quantity(f"w{a}", f"Rotation about {a}", f"ω{a}", "°", "diverging", _W, "angle") for a in "xyz"),
    Quantity(
        "sd_u", "Standard deviation of the translation", "sd u", "mm", "sequential", _SD, "significant",
        ("sd_ux", "sd_uy", "sd_uz"), "rms", _COMPONENTS_NOTE,
    ),
    *(Quantity(f"sd_u{a}", f"… along {a}", f"sd u{a}", "mm", "sequential", _SD) for a in "xyz"),
    Quantity(
        "sd_w", "Standard deviation of the rotation", "sd ω", "°", "sequential", _SD, "significant",
        ("sd_wx", "sd_wy", "sd_wz"), "rms", _COMPONENTS_NOTE,
    ),
    *(Quantity(f"sd_w{a}", f"… about {a}", f"sd ω{a}", "°", "sequential", _SD) for a in "xyz"),
    Quantity("residual", "Residual behind the grain", "residual", "", "sequential", "Fit", note=_RESIDUAL_MEANING),
    Quantity("iterations", "Iterations", "iterations", "", "sequential", "Fit"),
)  # fmt: skip
STRAIN_QUANTITIES = (
    Quantity(
        "volume_strain",
        "Volumetric strain",
        "tr e",
        "",
        "diverging",
        _E,
        "strain",
        STRAIN_NAMES[:3],
        "sum",
        _VOLUME_NOTE,
    ),
    *(
        Quantity(name, f"Strain {name[1:]}", name, "", "diverging", _E, "strain", note=_strain_note(name))
        for name in STRAIN_NAMES
    ),
    *(
        Quantity(f"sd_{name}", f"Standard deviation of strain {name[1:]}", f"sd {name}", "", "sequential", _E)
        for name in STRAIN_NAMES
    ),
)


def quantity_records(strains: bool) -> list[dict[str, object]]:
    """The quantities as plain data; with those of strains if some state has them."""
    return [asdict(quantity) for quantity in (*QUANTITIES, *(STRAIN_QUANTITIES if strains else ()))]
