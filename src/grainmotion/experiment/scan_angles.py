"""Angles of a circular scan: from the experiment file, from a file that it names, or from the radiographs' names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.file_names import Series, series_of
from grainmotion.diagnosis.file_series import DIGITS_OF_TIMES, FILE_SERIES, missing_numbers
from grainmotion.errors import InputError
from grainmotion.experiment.config_errors import ANGLES_REMEDY
from grainmotion.experiment.scan_tables import AngleRange, Circular
from grainmotion.io.angles import read_angles
from grainmotion.io.files import checked_file
from grainmotion.io.hdf5 import read_angles_deg
from grainmotion.io.named_angles import joined_angles_deg, read_named_angles
from grainmotion.io.stacks import Stack
from grainmotion.model.finding import Finding, Level

ANGLES_PLACE = "geometry.angles_deg"
IN_NAMES = "names"
"""Value of ``angles_deg`` for the numbers in the names of the radiographs."""
MAX_FILES_SHOWN = 4
MAX_LOST = 3
"""Numbers that leave out more than two files for each that is there do not count them."""
LIST_THEM = "give the angles as a list, or a text file with names and angles"


@dataclass(frozen=True)
class RadiographFiles:
    """What the files of a scan's radiographs tell: how many there are, and their names.

    Attributes
    ----------
    spec : str
        As the user wrote it.
    count : int
        Number of radiographs.
    names : tuple of str
        Of the files, if each holds one radiograph; else empty.
    series : bool
        Whether a pattern or a folder gave them.
    """

    spec: str
    count: int
    names: tuple[str, ...] = ()
    series: bool = False

    @classmethod
    def of(cls, stack: Stack) -> RadiographFiles:
        """Those of a stack."""
        count = stack.info()[0][0]
        names = tuple(file.name for file in stack.files) if len(stack.files) == count else ()
        return cls(stack.spec, count, names, stack.series)


def scan_angles_deg(
    table: Circular, folder: Path, files: RadiographFiles, recorded: Float | None
) -> tuple[Float, tuple[Finding, ...]]:
    """Angles of the views, degrees: those of the table, else those ``recorded`` in the scanner's file."""
    angles = table.angles_deg
    keys = {"first": table.first, "last": table.last, "count": table.count, "step": table.step}
    given = [name for name, value in keys.items() if value is not None]
    if angles is not None and given:
        raise InputError(ANGLES_PLACE, f"angles_deg and {', '.join(given)} are both given", "give either")
    if table.step is not None:
        return _by_steps(table, files)
    if given and len(given) < 3:
        missing = next(name for name in ("first", "last", "count") if name not in given)
        remedy = "give first, last and count" + ("" if "last" in given else ", or first and step")
        raise InputError(f"geometry.{missing}", f"it is missing beside {', '.join(given)}", remedy)
    if isinstance(angles, AngleRange):
        return np.linspace(angles.first, angles.last, angles.count), ()
    if angles == IN_NAMES:
        return _in_names(files)
    if isinstance(angles, str):
        return _of_file(angles, folder, files), ()
    if angles is not None:
        return np.array(angles, dtype=float), ()
    if table.first is not None and table.last is not None and table.count is not None:
        return np.linspace(table.first, table.last, table.count), ()
    if recorded is not None:
        return recorded, ()
    raise InputError(ANGLES_PLACE, "it is missing", ANGLES_REMEDY)


def _by_steps(table: Circular, files: RadiographFiles) -> tuple[Float, tuple[Finding, ...]]:
    """Angles at constant steps; those of files that are missing in the series are left out if ``count`` says so."""
    if table.first is None or table.step is None or table.last is not None:
        key = "first" if table.first is None else "last"
        fact = "it is missing beside step" if table.first is None else "it is given beside step"
        raise InputError(f"geometry.{key}", fact, "give first and step, or first, last and count")
    if table.step == 0:
        raise InputError("geometry.step", "it is 0, so that all views have one angle", "give the step in degrees")
    series = series_of(files.names) if files.series and files.names else []
    field, gone = _missing(series[0]) if len(series) == 1 else (0, [])
    count = table.count or files.count
    if not gone or (table.count is not None and table.count != files.count + len(gone)):
        return np.asarray(table.first + table.step * np.arange(count), dtype=float), ()
    names = [series[0].name_of(field, number) for number in gone]
    shown = ", ".join(names[:MAX_FILES_SHOWN]) + (", ..." if len(names) > MAX_FILES_SHOWN else "")
    if table.count is None:
        fact = f"{files.spec} lacks {shown}, and whether the stage went on over missing files is not told"
        remedy = f"set count = {files.count + len(gone)} if it did, count = {files.count} if not"
        raise InputError("geometry.step", fact, remedy)
    numbers = series[0].numbers[:, field]
    usual = (numbers.max() - numbers.min()) / (count - 1)
    angles = np.empty(files.count)
    angles[list(series[0].places)] = table.first + table.step * (numbers - numbers.min()) / usual
    fact = f"the angles of {shown}, which {'is' if len(gone) == 1 else 'are'} not there, were left out"
    return angles, (Finding(Level.NOTE, FILE_SERIES, "geometry.step", fact),)


def _missing(series: Series) -> tuple[int, list[float]]:
    """The field that counts the files, and its numbers that no file has: also of few files, and where many are lost."""
    field, gone = series.counter(), missing_numbers(series)
    if field is not None and gone:
        return field, gone
    if len(series.varying) != 1 or len(series.digits[series.varying[0]]) in DIGITS_OF_TIMES:
        return 0, []
    field = series.varying[0]
    values = np.sort(series.numbers[:, field])
    steps = np.diff(values) / max(np.diff(values).min(), 1e-9)
    expected = round(steps.sum()) + 1
    if np.any(np.abs(steps - np.round(steps)) > 1e-6) or expected > MAX_LOST * len(values):
        return 0, []
    places = values[0] + np.arange(expected) * np.diff(values).min()
    return field, [float(p) for p in places if np.abs(values - p).min() > 1e-6]


def _in_names(files: RadiographFiles) -> tuple[Float, tuple[Finding, ...]]:
    """The angles in the names of the files, and a finding that says which number was taken."""
    if not files.names:
        raise InputError(ANGLES_PLACE, f'"{IN_NAMES}" needs one file a radiograph, unlike {files.spec}', LIST_THEM)
    series = series_of(files.names)
    if len(series) > 1:
        strangers = [files.names[k] for s in series[1:] for k in s.places][:MAX_FILES_SHOWN]
        fact = f"{', '.join(strangers)} of {files.spec} are named unlike {series[0].pattern}"
        raise InputError(ANGLES_PLACE, fact, "narrow the pattern to files of one name, or " + LIST_THEM)
    field = _angle_field(series[0], files.names[0])
    angles = np.empty(files.count)
    angles[list(series[0].places)] = series[0].numbers[:, field]
    shown = ", ".join(f"{a:g}" for a in angles[:MAX_FILES_SHOWN]) + (", ..." if len(angles) > MAX_FILES_SHOWN else "")
    texts = [*series[0].texts, ""]
    fact = f"the angles are the numbers after '{texts[field]}' in the files' names: {shown} degrees"
    return angles, (Finding(Level.NOTE, FILE_SERIES, ANGLES_PLACE, fact, f"first file {files.names[0]}"),)


def _angle_field(series: Series, name: str) -> int:
    """Which number of the names is the angle."""
    field = series.angle_field()
    if field is not None:
        return field
    varying = series.varying
    if not varying:
        raise InputError(ANGLES_PLACE, f"the names carry no angle: {name}", LIST_THEM)
    if len(varying) > 1:
        numbers = ", ".join(series.digits[k] for k in varying)
        fact = f"which number is the angle is not clear: {numbers} in {name}"
        raise InputError(ANGLES_PLACE, fact, "rename the files so that 'deg' stands beside the angle, or " + LIST_THEM)
    steps = np.diff(np.sort(series.numbers[:, varying[0]]))
    if np.all(steps == 1):
        fact = f"the only number in the names, {series.digits[varying[0]]} in {name}, counts the files"
        raise InputError(ANGLES_PLACE, fact, "give first and step; whole degrees are first = 0, step = 1")
    return varying[0]


def _of_file(angles: str, folder: Path, files: RadiographFiles) -> Float:
    """The angles of a file: a dataset, a column, or a table with the names of the radiographs."""
    name, _, inner = angles.partition("::")
    path = checked_file(folder / name)
    if inner:
        return read_angles_deg(path, inner)
    table = read_named_angles(path)
    if table is None:
        return read_angles(path)
    if not files.names:
        fact = f"it names files, but {files.spec} does not hold one radiograph a file"
        raise InputError(str(path), fact, "give one angle a line, in the order of the radiographs")
    return joined_angles_deg(path, table, files.names)
