"""Several files of one scanner, each with some radiographs of one scan, as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.model.finding import Finding, Level

MAX_JOINED_DIFFERENCE = 1e-3
"""Numbers of files of one scan may differ by so much, relative: encoders of distances vary."""


def joined_scan(files: Sequence[ScannerFile]) -> ScannerFile:
    """One description of all radiographs, in the order of the files; flats are those of the first."""
    first, known = files[0], files[0].circle.known
    for file in files[1:]:
        other = file.circle.known
        for name in sorted(known.keys() | other.keys()):
            if not _alike(known.get(name), other.get(name)):
                fact = f"its {name} is {other.get(name)}, but that of {first.path.name} is {known.get(name)}"
                raise InputError(str(file.path), fact, "give radiographs of one scan, or the geometry by hand")
    angles = [f.circle.angles_deg for f in files]
    told = None if any(a is None for a in angles) else np.concatenate([a for a in angles if a is not None])
    counts = [0 if a is None else len(a) for a in angles]
    return replace(
        first,
        circle=replace(first.circle, angles_deg=told),
        radiographs=tuple(spec for f in files for spec in f.radiographs),
        image_shifts=_stacked([f.image_shifts for f in files], counts),
        beam_levels=None,  # they are over the flats of each file
        findings=(*dict.fromkeys(finding for f in files for finding in f.findings), *_exposures(files)),
    )


def _exposures(files: Sequence[ScannerFile]) -> tuple[Finding, ...]:
    """A finding if radiographs were exposed for another time than the flats in their files."""
    if all(f.beam_levels is None for f in files):
        return ()
    fact = "exposures of radiographs and flats differ, and flats of one file cannot be scaled to the others"
    remedy = "give flats of the exposure of the radiographs"
    return (Finding(Level.WARNING, "beam-level", files[0].path.name, fact, remedy=remedy),)


def _alike(a: object, b: object) -> bool:
    """Whether two numbers, tuples or words of files are the same."""
    if isinstance(a, float | tuple) and isinstance(b, float | tuple):
        return bool(np.allclose(a, b, rtol=MAX_JOINED_DIFFERENCE))
    return a == b


def _stacked(parts: list[Float | None], counts: list[int]) -> Float | None:
    """Shifts of all views, zero in files that have none."""
    if all(part is None for part in parts):
        return None
    return np.concatenate([np.zeros((n, 2)) if p is None else p for p, n in zip(parts, counts)])
