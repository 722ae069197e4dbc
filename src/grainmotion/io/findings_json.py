"""Findings as JSON: a list with one object each, the fields of `grainmotion.model.finding.Finding`."""

from __future__ import annotations

import json
from pathlib import Path

from grainmotion.errors import InputError
from grainmotion.io.files import atomic_write, checked_file
from grainmotion.model.finding import Finding


def read_findings(path: str | Path) -> tuple[Finding, ...]:
    """Read the findings of a check; an `InputError` names a file that holds none."""
    path = checked_file(path)
    try:
        return tuple(Finding.from_dict(item) for item in json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(str(path), f"no list of findings ({error})", "delete it") from error


def write_findings(path: str | Path, findings: tuple[Finding, ...]) -> None:
    """Write the findings of a check."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps([f.to_dict() for f in findings], indent=1), encoding="utf-8")
