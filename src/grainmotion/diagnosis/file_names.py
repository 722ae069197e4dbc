"""Numbers in the names of files: their order, and what the numbers of a series are.

Only names are looked at, not files.  A '-' before a number is a sign only if some names of the list have it there and
others do not: in ``2024-05-12`` and in ``proj-0001`` it separates.  A '.' is a decimal point only if the numbers that
it makes all differ and their whole parts vary: in ``scan1.9``, ``scan1.10`` it separates.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float

_WHOLE = re.compile(r"(\d+)")
_DECIMAL = re.compile(r"((?:(?<![0-9A-Za-z.+-])[-+])?\d+(?:\.\d+)?(?!\.\d))")
_ANGLE_WORD = re.compile(r"(?:angle|theta|phi|omega|rot|deg|°)[ _=-]*$", re.IGNORECASE)
_DEGREE_WORD = re.compile(r"^[ _]?(?:deg|°)", re.IGNORECASE)


@dataclass(frozen=True)
class Series:
    """Names of a list that differ in their numbers only.

    Attributes
    ----------
    places : tuple of int
        Indices of the names in the list.
    numbers : (names, fields) array
        The numbers in each name.
    decimal : bool
        Whether they are read with signs and decimals.
    texts : tuple of str
        What is around the numbers.
    suffix : str
        Of the first name.
    digits : tuple of str
        The numbers of the first name as they are written.
    """

    places: tuple[int, ...]
    numbers: Float
    decimal: bool
    texts: tuple[str, ...]
    suffix: str
    digits: tuple[str, ...]

    @property
    def pattern(self) -> str:
        """The common name, with # for each number."""
        return "#".join(self.texts) + self.suffix

    def name_of(self, field: int, number: float) -> str:
        """The name of a file with another number in one field; without others that vary, else with # for these."""
        words = []
        for k, digits in enumerate(self.digits):
            if k == field:
                words.append(f"{number:g}" if "." in digits else f"{int(number):0{len(digits)}d}")
            else:
                words.append("#" if np.ptp(self.numbers[:, k]) > 0 else digits)
        return "".join(text + word for text, word in zip(self.texts, [*words, self.suffix]))

    def counter(self) -> int | None:
        """The field that counts the files: all different, most steps alike; None if there is none.

        Of several, the one with the smallest step, so that times of day beside a counter are left out.
        """
        found = []
        for field in range(self.numbers.shape[1]):
            values = np.sort(self.numbers[:, field])
            steps = np.diff(values)
            if len(steps) and steps.min() > 0:
                usual, times = Counter(steps.tolist()).most_common(1)[0]
                if times >= MIN_SHARE_OF_USUAL_STEPS * len(steps):
                    found.append((usual, field))
        return min(found)[1] if found else None

    @property
    def varying(self) -> list[int]:
        """The fields whose numbers are not all the same."""
        return [k for k in range(self.numbers.shape[1]) if np.ptp(self.numbers[:, k]) > 0]

    @property
    def fields_with_angle_words(self) -> list[int]:
        """The varying fields beside a word for angles."""
        return [k for k in self.varying if _ANGLE_WORD.search(self.texts[k]) or _DEGREE_WORD.match(self.texts[k + 1])]

    def angle_field(self) -> int | None:
        """The field of angles: the only one with signs or decimals, or one beside a word for angles."""
        varying, worded = self.varying, self.fields_with_angle_words
        if len(worded) == 1:
            return worded[0]
        if self.decimal:
            broken = [k for k in varying if np.any(self.numbers[:, k] % 1) or np.any(self.numbers[:, k] < 0)]
            return broken[0] if len(broken) == 1 else None
        return None

    def angles(self) -> Float | None:
        """Angles that the names carry, if one of their numbers is one."""
        field = self.angle_field()
        return None if field is None else self.numbers[:, field]


MIN_SHARE_OF_USUAL_STEPS = 0.7
"""Numbers of files count them if at least this share of their steps is the usual one.

Counted series with one to three gaps have 0.9 and more; chosen views such as 0, 17, 30, 45 have less than 0.5.
"""


def stem(name: str) -> str:
    """A name without the suffix of its format."""
    dot = name.rfind(".")
    suffix = name[dot + 1 :]
    return name[:dot] if dot > 0 and suffix.isalnum() and not suffix.isdigit() else name


def natural_order(names: Sequence[str]) -> list[int]:
    """Indices that sort names by the numbers in them: 2 before 10, -12.5 before 3, p1.25 before p1.5."""
    stems = [stem(name) for name in names]
    pattern = _DECIMAL if _reads_as_decimal(stems) else _WHOLE
    return sorted(range(len(names)), key=lambda k: (_parts(stems[k], pattern), names[k]))


def series_of(names: Sequence[str]) -> list[Series]:
    """The series in a list of names, the largest first."""
    stems = [stem(name) for name in names]
    decimal = _reads_as_decimal(stems)
    pattern = _DECIMAL if decimal else _WHOLE
    groups: dict[tuple[str, ...], list[int]] = {}
    for k, text in enumerate(stems):
        groups.setdefault(tuple(pattern.split(text)[::2]), []).append(k)
    series = []
    for texts, members in groups.items():
        numbers = [[float(n) for n in pattern.split(stems[k])[1::2]] for k in members]
        array = np.array(numbers, dtype=float).reshape(len(members), len(texts) - 1)
        first = members[0]
        suffix = names[first][len(stems[first]) :]
        digits = tuple(pattern.split(stems[first])[1::2])
        series.append(Series(tuple(members), array, decimal, texts, suffix, digits))
    return sorted(series, key=lambda s: -len(s.places))


def _parts(text: str, pattern: re.Pattern[str]) -> list[str | float]:
    """Text and numbers in turn."""
    return [float(part) if k % 2 else part for k, part in enumerate(pattern.split(text))]


def _reads_as_decimal(stems: Sequence[str]) -> bool:
    """Whether numbers of a list have signs and decimals, rather than '-' and '.' between them."""
    split = [_DECIMAL.split(text) for text in stems]
    usual = Counter(tuple(parts[::2]) for parts in split).most_common(1)
    if not usual:
        return False
    numbers = [parts[1::2] for parts in split if tuple(parts[::2]) == usual[0][0]]
    if len(numbers) < 2 or len(numbers) < len(stems) / 2:
        return False
    for field in zip(*numbers):
        signed = [text.startswith(("-", "+")) for text in field]
        broken = [text for text in field if "." in text]
        whole = {text.lstrip("+-").split(".")[0] for text in field}
        values = {float(text) for text in field}
        if any(signed) and not all(signed):
            return True
        if broken and len(whole) > 1 and len(values) == len(set(field)):
            return True
    return False
