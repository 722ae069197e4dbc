"""Findings: what a check of the input or of a result noticed, and what to do about it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Literal, get_args

from grainmotion.errors import InputError

Check = Literal[
    "angle-table", "beam-images", "beam-level", "calibration", "coinciding-views", "common-cause", "eight-bit",
    "field-of-view", "file-series", "fit", "frames", "gain", "given-volume", "grain-scale", "grain-sizes",
    "hardening", "inspect", "kind", "labels", "monitor", "motors", "moving-sample", "new-grain", "offset", "opaque",
    "pixels", "reference-geometry", "saturation", "sense-of-rotation", "sign", "sizes", "start-file", "state-geometry",
    "unlabelled", "version", "views",
]  # fmt: skip
"""Names of all checks; docs/troubleshooting.md has a section on each."""


class Level(StrEnum):
    """How serious a finding is.

    ``NOTE``: worth knowing.  ``WARNING``: results may be wrong or less accurate.  ``ERROR``: results would be wrong;
    the work stops before it begins, unless the user forces it.

    Examples
    --------
    >>> [finding.fact for finding in gm.check_state(grains, state) if finding.level == gm.Level.ERROR]
    []
    """

    NOTE = "note"
    WARNING = "warning"
    ERROR = "error"


SEVERITY = (Level.ERROR, Level.WARNING, Level.NOTE)
"""Levels, the worst first."""


@dataclass(frozen=True)
class Finding:
    """What one check noticed.

    Attributes
    ----------
    level : Level
    check : Check
        Name of the check, as in ``docs/troubleshooting.md``.
    where : str
        File, key, state, view or grain.
    fact : str
        What is wrong, with its likely cause.
    evidence : str
        The measured numbers behind it.
    remedy : str
        What to do, with the key to change.
    fix : str
        Name of the hypothesis that ``--try-fixes`` or the key ``fixes`` applies; empty if there is none.

    Examples
    --------
    >>> finding = gm.Finding(gm.Level.WARNING, "file-series", "reference", "radiograph 7 is missing")
    >>> finding.line
    'warning: reference: radiograph 7 is missing [file-series]'
    """

    level: Level
    check: Check
    where: str
    fact: str
    evidence: str = ""
    remedy: str = ""
    fix: str = ""

    def __post_init__(self) -> None:
        if self.check not in get_args(Check):
            raise InputError("finding", f"the check '{self.check}' is unknown", f"use one of {get_args(Check)}")

    def __str__(self) -> str:
        evidence = f" ({self.evidence})" if self.evidence else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.where}: {self.fact}{evidence}{remedy}"

    @property
    def line(self) -> str:
        """Level, sentence, and the name under which ``docs/troubleshooting.md`` says more."""
        return f"{self.level}: {self} [{self.check}]"

    def to_dict(self) -> dict[str, str]:
        """Plain data, for a JSON file."""
        return {name: str(value) for name, value in asdict(self).items()}

    @classmethod
    def from_dict(cls, data: dict[str, str]) -> Finding:
        """The finding behind `to_dict`.

        Parameters
        ----------
        data : dict
            Its items.

        Returns
        -------
        Finding
            The same finding.
        """
        return cls(**{**data, "level": Level(data["level"])})  # type: ignore[arg-type]


def worst_first(findings: tuple[Finding, ...] | list[Finding]) -> tuple[Finding, ...]:
    """Findings sorted by severity, without repetitions; those of one level stay in their order.

    Parameters
    ----------
    findings : sequence of Finding
        In the order in which they were made.

    Returns
    -------
    tuple of Finding
        Errors, then warnings, then notes.
    """
    return tuple(sorted(dict.fromkeys(findings), key=lambda finding: SEVERITY.index(finding.level)))
