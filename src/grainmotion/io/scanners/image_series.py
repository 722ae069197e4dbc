"""Radiographs that lie beside a scanner's file: where they are, and which of the planned views they show."""

from __future__ import annotations

import glob
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion._typing import Index
from grainmotion.diagnosis.file_names import natural_order, series_of
from grainmotion.errors import InputError
from grainmotion.io.formats import TIFF
from grainmotion.io.tiff import tiff_info
from grainmotion.model.finding import Finding, Level

MAX_PLANNED_VIEWS = 1_000_000
"""No scan has so many radiographs: the number is damaged."""


@dataclass(frozen=True, eq=False)
class ImageSeries:
    """Files of radiographs, in the order of the numbers in their names.

    Attributes
    ----------
    files : tuple of Path
        TIFF files of one image each.
    pattern : tuple of str
        Their specification for `grainmotion.io.stacks.find_stack`; empty if there are none.
    """

    files: tuple[Path, ...] = ()
    pattern: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, int] | None:
        """Rows and columns of the first."""
        return tiff_info(self.files[0])[0][1:] if self.files else None


def tiff_files(folder: Path, pattern: str = "*", without: str | None = None) -> ImageSeries:
    """The TIFF files of a folder whose names match a pattern and do not begin with a text."""
    names = [p for p in folder.glob(pattern) if p.suffix.lower() in TIFF and not p.name.startswith(".")]
    if not names:
        return ImageSeries()
    files = tuple(names[k] for k in natural_order([p.name for p in names]))
    if without is not None and (left := tuple(p for p in files if not p.name.startswith(without))) != files:
        return ImageSeries(left, tuple(str(p.absolute()) for p in left))
    if not Path(pattern).suffix:
        suffixes = {p.suffix for p in files}
        pattern += suffixes.pop() if len(suffixes) == 1 else ".[tT][iI][fF]*"
    return ImageSeries(files, (f"{glob.escape(str(folder.absolute()))}/{pattern}",))


def views_shown(path: Path, series: ImageSeries, planned: int) -> tuple[Index, tuple[Finding, ...]]:
    """Which of ``planned`` views the files are, by the numbers in their names, and a finding if some are missing."""
    count = len(series.files)
    if planned > MAX_PLANNED_VIEWS:
        raise InputError(str(path), f"it describes {planned:.3g} radiographs", "correct it, or export it again")
    if count == planned or count == 0:
        return np.arange(planned), ()
    if count > planned:
        fact = f"it describes {planned} radiographs, but {count} lie in {series.files[0].parent.name}"
        raise InputError(str(path), fact, "move images of other scans away")
    views, numbers = np.arange(count), series_of([p.name for p in series.files])
    if len(numbers) == 1 and numbers[0].numbers.shape[1]:
        varying = [field for field in numbers[0].numbers.T if len(np.unique(field)) == count]
        steps = varying[-1] - varying[-1].min() if varying else views
        if steps.max() < planned and np.array_equal(steps, np.rint(steps)):
            views = steps.astype(int)
    fact = f"{count} of {planned} radiographs are there: the scan was stopped or not completely copied"
    return views, (Finding(Level.WARNING, "frames", path.name, fact, remedy="those that are there were used"),)
