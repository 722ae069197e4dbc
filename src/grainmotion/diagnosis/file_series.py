"""What the names of a scan's files say against what is told about them: gaps, strangers, order and angles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.file_names import Series, natural_order, series_of
from grainmotion.model.finding import Check, Finding, Level

FILE_SERIES: Check = "file-series"
MIN_FILES_FOR_A_GAP = 6
"""Of fewer files no usual step of their numbers can be told."""
MIN_FILES_OF_A_SERIES = 3
MAX_NAMES_SHOWN = 4
MAX_STEP_ERROR = 0.3
"""Of a step of the angles, over the usual one; where a file is missing that is not left out, it is 1."""
DIGITS_OF_TIMES = (6, 12, 14)
"""Of hhmmss, yymmddhhmmss and yyyymmddhhmmss."""
MAX_ANGLE_ERROR_DEG = 0.51
"""Largest rounding of angles in names, whole degrees.  Wrong orders differ by a step or more."""


def series_findings(
    where: str, names: Sequence[str], angles_deg: Float | None, elsewhere: Sequence[str] = ()
) -> tuple[Finding, ...]:
    """Findings about files that a pattern or folder gave, one image each.

    Parameters
    ----------
    where : str
        Key of the files.
    names : sequence of str
        Their names, in the order in which they are taken.
    angles_deg : array or None
        The told angle of each; None if these are not one for each file.
    elsewhere : sequence of str
        Names of the same scan's other files, flats and darks, which may have numbers of the same counter.
    """
    series = series_of(names)
    if not series or len(series[0].places) < MIN_FILES_OF_A_SERIES:
        return ()
    findings = [*stranger_findings(where, names), *_gaps(where, names, series[0], angles_deg, elsewhere)]
    findings += _repeated(where, names, series[0])
    if angles_deg is not None and len(angles_deg) == len(names):
        findings += _angles_in_names(where, series[0], angles_deg[list(series[0].places)])
    return tuple(findings)


def stranger_findings(where: str, names: Sequence[str]) -> tuple[Finding, ...]:
    """A finding about files that are named unlike the largest series of a pattern's files."""
    series = series_of(names)
    strangers = sorted(k for s in series[1:] for k in s.places)
    if len(series) == 2 and MIN_FILES_OF_A_SERIES <= len(series[0].places) == len(series[1].places):
        fact = f"two series of files, taken as they are sorted: {series[0].pattern} and {series[1].pattern}"
        remedy = "if only one of them belongs to the scan, narrow the pattern"
        return (Finding(Level.NOTE, FILE_SERIES, where, fact, f"{len(strangers)} files each", remedy),)
    if not strangers or len(series[0].places) <= max(len(strangers), MIN_FILES_OF_A_SERIES - 1):
        return ()
    pattern = series[0].pattern
    first = _shown([names[k] for k in strangers])
    fact = f"{first} {_is(strangers)} named unlike the other files: a preview, flats, or another scan?"
    evidence = f"{len(series[0].places)} files {pattern}, {len(strangers)} others"
    remedy = f'narrow the pattern, as in "{pattern.replace("#", "*")}"'
    return (Finding(Level.WARNING, FILE_SERIES, where, fact, evidence, remedy),)


def listed_order(where: str, names: Sequence[str]) -> tuple[Finding, ...]:
    """A finding about a list of files that names one twice, or is sorted as text: 1, 10, 11, 2."""
    twice = [name for name, times in Counter(names).items() if times > 1]
    if twice:
        fact = f"{_shown(twice)} {_is(twice)} listed more than once"
        return (Finding(Level.WARNING, FILE_SERIES, where, fact, f"{len(names)} files", "list each view's own file"),)
    order = natural_order(names)
    if len(names) < MIN_FILES_OF_A_SERIES or order == list(range(len(names))) or list(names) != sorted(names):
        return ()
    if len(series_of(names)) > 1:
        return ()
    shown = ", ".join(names[:MAX_NAMES_SHOWN])
    fact = "the files are listed as sorted text, not by the numbers in their names"
    remedy = "list them in the order of the angles, or give a pattern, which sorts by the numbers"
    return (Finding(Level.WARNING, FILE_SERIES, where, fact, shown, remedy),)


def count_hint(names: Sequence[str], views: int, shape: tuple[int, int, int], angles_deg: Float | None) -> str:
    """The likely cause of ``shape[0]`` radiographs for another number of views; empty if none is likely.

    ``names`` are those of the files if each holds one image; ``shape`` is (images, rows, columns).
    """
    count = shape[0]
    if len(names) == count:
        series = series_of(names)
        strangers = [k for s in series[1:] for k in s.places]
        if strangers and len(series[0].places) == views:
            return f"{_shown([names[k] for k in strangers])} {_is(strangers)} named unlike the others: no radiographs?"
        missing = missing_numbers(series[0]) if not strangers else []
        if missing and count + len(missing) == views:
            return f"missing in the series: {_shown(_missing_names(series[0], missing))}"
    if views in shape[1:] and len(names) != count:
        axis = "second" if shape[1] == views else "third"
        return (
            f"the stack has the shape {shape}, and its {axis} axis has {views}: sinograms? The order of the axes is "
            "views, rows, columns"
        )
    if views == count + 1 and angles_deg is not None and _one_direction(angles_deg[0], angles_deg[-1]):
        return "the first and the last angle are one direction: leave out the last"
    if views == count + 1:
        return "is the last angle, of the end point, counted too?"
    if count == views + 1:
        return "is one of them taken again at the end, a flat or a preview, or is an angle missing?"
    if count > views:
        return "are flats or darks among them?"
    return ""


def missing_numbers(series: Series) -> list[float]:
    """Numbers that a counted series leaves out; none if it does not count, or jumps further than its length."""
    field = series.counter()
    if field is None or len(series.places) < MIN_FILES_FOR_A_GAP:
        return []
    values = np.sort(series.numbers[:, field])
    usual = Counter(np.diff(values).tolist()).most_common(1)[0][0]
    missing: list[float] = []
    for before, after in pairwise(values):
        steps = round((after - before) / usual)
        if steps > len(values):
            return []
        missing += [float(before + k * usual) for k in range(1, steps)]
    return [] if _are_times(series, field, missing) else missing


def _are_times(series: Series, field: int, missing: Sequence[float]) -> bool:
    """Whether numbers are times such as 101550 and 20240512101550, whose next is 101600: they leave nothing out."""
    if len(series.digits[field]) not in DIGITS_OF_TIMES or not missing:
        return False
    minutes, seconds = (series.numbers[:, field] // d % 100 for d in (100, 1))
    no_times = [number % 100 >= 60 or number // 100 % 100 >= 60 for number in missing]
    return bool(max(minutes.max(), seconds.max()) < 60 and all(no_times))


# ------------------------------------------------------------------------------------------------ checks
def _gaps(
    where: str, names: Sequence[str], series: Series, angles_deg: Float | None, elsewhere: Sequence[str]
) -> list[Finding]:
    """Missing numbers of a counted series, unless other files have them or the angles leave them out too."""
    missing = missing_numbers(series)
    field = series.counter()
    if field is None:
        return []
    if not missing:
        return _restarted(where, names, series, field)
    values = series.numbers[:, field]
    others = set[float]()
    for s in series_of(elsewhere):
        if s.texts[0] == series.texts[0] and s.numbers.shape[1] == series.numbers.shape[1]:
            theirs = s.numbers[:, field]
            if not np.isin(theirs, values).any():  # else they have a counter of their own
                others.update(theirs.tolist())
    missing = [number for number in missing if number not in others]
    if not missing or (angles_deg is not None and len(angles_deg) == len(names) and _left_out(values, angles_deg)):
        return []
    gone = _missing_names(series, missing)
    k = int(np.searchsorted(np.sort(values), missing[0]))
    around = [names[series.places[j]] for j in np.argsort(values)[k - 1 : k + 1]]
    fact = f"the series of files has {_gap_word(missing)}: {_shown(gone)} {_is(missing)} not there"
    evidence = f"{around[1]} follows {around[0]}; {len(names)} files"
    remedy = "copy what is missing, or leave out its angles: the angles of all files behind a gap are wrong otherwise"
    return [Finding(Level.WARNING, FILE_SERIES, where, fact, evidence, remedy)]


def _left_out(values: Float, angles_deg: Float) -> bool:
    """Whether the angle steps wherever the numbers of the files do: angles leave out what the files leave out."""
    order = np.argsort(values)
    numbers, angles = np.diff(values[order]), np.diff(angles_deg[order])
    apart = numbers > 0
    usual = np.median(angles[apart] / numbers[apart])  # degrees from a number to the next
    return bool(np.abs(angles - usual * numbers).max() < MAX_STEP_ERROR * abs(usual) * np.median(numbers))


def _restarted(where: str, names: Sequence[str], series: Series, field: int) -> list[Finding]:
    """A counter that jumps by more than the number of files: it restarted, and its order is not that in time."""
    values = np.sort(series.numbers[:, field])
    if len(values) < MIN_FILES_FOR_A_GAP or np.diff(values).max() <= np.median(np.diff(values)) * len(values):
        return []
    k = int(np.argmax(np.diff(values)))
    order = np.argsort(series.numbers[:, field])
    before, after = (names[series.places[order[j]]] for j in (k, k + 1))
    fact = "the numbers of the files jump: two scans in one folder, or a counter that began again"
    remedy = "the files are taken by their numbers; if they were taken in another order, list them in it"
    return [Finding(Level.WARNING, FILE_SERIES, where, fact, f"{after} follows {before}", remedy)]


def _repeated(where: str, names: Sequence[str], series: Series) -> list[Finding]:
    """Two files with the same numbers, written differently."""
    seen: dict[tuple[float, ...], int] = {}
    for place, row in zip(series.places, series.numbers):
        first = seen.setdefault(tuple(row), place)
        if first != place:
            fact = f"{names[first]} and {names[place]} have the same number"
            return [Finding(Level.WARNING, FILE_SERIES, where, fact, "", "keep one of them")]
    return []


def _angles_in_names(where: str, series: Series, told_deg: Float) -> list[Finding]:
    """Angles in the names that contradict the told ones: another order, other values."""
    named = series.angles()
    if named is None or len(named) < MIN_FILES_OF_A_SERIES or np.ptp(named) == 0:
        return []
    if _alike(named, told_deg):
        return []
    shown = ", ".join(f"{a:g}" for a in named[:MAX_NAMES_SHOWN])
    evidence = f"names: {shown}, ...; told: {', '.join(f'{a:g}' for a in told_deg[:MAX_NAMES_SHOWN])}, ..."
    remedy = "correct angles_deg, or list the files in the order of the angles"
    if _alike(np.sort(named), np.sort(told_deg)):
        fact = "the files' names carry the told angles in another order"
        return [Finding(Level.ERROR, FILE_SERIES, where, fact, evidence, remedy)]
    if _alike(-named, told_deg):
        fact = "the files' names carry the told angles with the other sign"
        sense = "right only if the stage counts its angles the other way"
        return [Finding(Level.NOTE, FILE_SERIES, where, fact, evidence, sense)]
    if _alike(named - named[0], told_deg - told_deg[0]):
        fact = "the files' names carry angles that begin elsewhere than the told ones"
        one = "right only if every scan of this sample is told with the same difference"
        return [Finding(Level.NOTE, FILE_SERIES, where, fact, evidence, one)]
    fact = "the files' names carry other angles than the told ones"
    return [Finding(Level.WARNING, FILE_SERIES, where, fact, evidence, remedy)]


def _alike(first_deg: Float, second_deg: Float) -> bool:
    """Whether angles are the same but for rounding and whole turns."""
    apart = (first_deg - second_deg + 180) % 360 - 180
    step = np.diff(np.sort(second_deg))
    usual = float(np.median(step)) if len(step) else 1.0
    return bool(np.abs(apart).max() < min(MAX_ANGLE_ERROR_DEG, max(0.49 * usual, 1e-6)))


def _one_direction(first_deg: float, last_deg: float) -> bool:
    return abs((last_deg - first_deg + 180) % 360 - 180) < 1e-6


# ------------------------------------------------------------------------------------------------ words
def _missing_names(series: Series, missing: Sequence[float]) -> list[str]:
    """Names as the missing files would have them."""
    field = series.counter()
    return [] if field is None else [series.name_of(field, number) for number in missing]


def _gap_word(missing: Sequence[float]) -> str:
    return "a gap" if len(missing) == 1 else f"{len(missing)} files too few"


def _is(items: Sequence[object]) -> str:
    return "is" if len(items) == 1 else "are"


def _shown(names: Sequence[str]) -> str:
    more = len(names) - MAX_NAMES_SHOWN
    return ", ".join(names[:MAX_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")
