"""Remedies: the settings that a user would choose for each hard case, compared with the default."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from grainmotion.segmentation.extraction import Background
from grainmotion.tracking.track import TrackSettings


@dataclass(frozen=True)
class Remedy:
    """A way to track a hard case.

    Attributes
    ----------
    name : str
        The setting as a user writes it.
    settings : TrackSettings
    background : {"auto", "ignore", "fixed", "moving"}
        Of `grains_from_labels`.
    calibrated : {"", "geometry", "hardening"}
        Calibration on the reference scan before anything else.
    """

    name: str
    settings: TrackSettings = field(default_factory=TrackSettings)
    background: Background = "auto"
    calibrated: Literal["", "geometry", "hardening"] = ""


DEFAULT = Remedy("default")
HUBER = Remedy('loss = "huber"', TrackSettings(loss="huber"))
REMEDIES: Mapping[str, tuple[Remedy, ...]] = MappingProxyType(
    {
        "noisy": (
            Remedy('weights = "photons"', TrackSettings(weights="photons")),
            Remedy('loss = "poisson"', TrackSettings(weights="photons", loss="poisson")),
        ),
        "beam-hardening": (
            Remedy("calibrated", calibrated="hardening"),
            Remedy("hardening = 2", TrackSettings(hardening=2)),
            Remedy("hardening = 3", TrackSettings(hardening=3)),
        ),
        "misaligned": (Remedy("calibrated", calibrated="geometry"),),
        "misaligned-state": (Remedy("view_corrections", TrackSettings(view_corrections=True)),),
        "gain-drift-views": (Remedy('gain = "view"', TrackSettings(gain="view")),),
        "container": (
            Remedy('background = "fixed"', background="fixed"),
            Remedy('background = "ignore"', background="ignore"),
        ),
        "missing": (HUBER,),
        "broken": (HUBER,),
    }
)
"""By the name of the case; those that are not here have the default alone."""


def remedies(case: str) -> tuple[Remedy, ...]:
    """All ways to track a case, the default first."""
    return (DEFAULT, *REMEDIES.get(case, ()))
