"""The images of a scan by the numbers in their names, and what is missing of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from grainmotion.diagnosis.file_series import FILE_SERIES
from grainmotion.io.formats import TIFF
from grainmotion.io.tiff import tiff_info
from grainmotion.model.finding import Finding, Level

MAX_RANGES_SHOWN = 4
"""Ranges of missing numbers that a message names."""


def numbered_images(folder: Path, prefix: str) -> dict[int, Path]:
    """The TIFF files ``prefix`` + number of a folder, in the order of their numbers.

    Letters may differ in case, as on the scanner's computer.  Where numbers are padded with zeros, names of another
    width belong to another scan whose name begins alike.
    """
    pattern = re.compile(re.escape(prefix) + r"(\d+)", re.IGNORECASE)
    found: list[tuple[str, Path]] = []
    for path in sorted(folder.iterdir()):
        match = pattern.fullmatch(path.stem)
        if match is not None and path.suffix.lower() in TIFF and path.is_file():
            found.append((match.group(1), path))
    width = min((len(digits) for digits, _ in found if _is_padded(digits)), default=0)
    images: dict[int, Path] = {}
    for digits, path in found:
        if len(digits) == width or (len(digits) > width and not _is_padded(digits)):
            images.setdefault(int(digits), path)
    return dict(sorted(images.items()))


def series_of_scan(
    where: str, images: Mapping[int, Path], numbers: range, spare: frozenset[int] = frozenset()
) -> tuple[dict[int, Path], tuple[Finding, ...]]:
    """The images with ``numbers``, and findings about those that are missing or too many.

    The numbers in ``spare`` are used if they are there and not missed if they are not.
    """
    kept = {n: path for n, path in images.items() if n in numbers or n in spare}
    missing = [n for n in numbers if n not in kept and n not in spare]
    found = []
    if len(kept) < len(images):
        excess = [n for n in images if n not in kept]
        fact = f"it tells of {len(numbers)} images, but there are {len(images)}"
        remedy = f"numbers {_ranges(excess)} are not used; move images of another scan away, or correct the file"
        found.append(Finding(Level.WARNING, FILE_SERIES, where, fact, remedy=remedy))
    if kept and missing:
        last, fact = max(kept), f"{len(kept)} of {len(numbers)} images are there"
        interrupted = missing[0] > last
        fact += (
            f", up to number {last}: the scan was interrupted" if interrupted else f"; {_ranges(missing)} are missing"
        )
        remedy = "those there are used, each with its own angle; copy the others from the scanner if there are any"
        found.append(Finding(Level.WARNING, FILE_SERIES, where, fact, remedy=remedy))
    return kept, tuple(found)


def size_findings(
    where: str, images: Mapping[int, Path], told: tuple[float | None, float | None]
) -> tuple[Finding, ...]:
    """That the first image has other rows and columns than a scanner's file tells; None where it tells none."""
    if not images:
        return ()
    path = next(iter(images.values()))
    _, *size = tiff_info(path)[0]
    if all(n is None or n == have for n, have in zip(told, size, strict=True)):
        return ()
    rows, columns = (f"{n:g}" if n is not None else "?" for n in told)
    fact = f"it tells of {rows} x {columns} pixels (rows, columns), but {path.name} has {size[0]} x {size[1]}"
    remedy = "give the images as the scanner wrote them; binned or cropped ones need their own geometry"
    return (Finding(Level.ERROR, "sizes", where, fact, remedy=remedy),)


def _is_padded(digits: str) -> bool:
    return digits.startswith("0") and len(digits) > 1


def _ranges(numbers: Iterable[int]) -> str:
    """Whole numbers in ascending order as text: 3, 7-9."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    shown = [str(a) if a == b else f"{a}-{b}" for a, b in ranges[:MAX_RANGES_SHOWN]]
    return ", ".join(shown) + (f" and {len(ranges) - len(shown)} more ranges" if len(ranges) > len(shown) else "")
