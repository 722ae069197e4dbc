"""What a record shows of itself: a line in a terminal, a small table with a picture in a notebook.

Records hold large arrays, which nobody wants printed.  `Summarised` gives them both forms from one `Summary`; those
without a summary of their own list their fields, arrays by shape.  Making one takes milliseconds, whatever the size of
the record: only shapes, few numbers and thinned pictures are looked at.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.status import STATUS_COLOURS

MAX_TEXT = 160
"""Characters of a value; longer ones end in an ellipsis."""
MAX_ITEMS = 8
"""Items of a sequence that are listed."""
NOTHING: Mapping[str, int] = MappingProxyType({})
STYLE = (
    "<style>.grainmotion{display:flex;gap:1.2em;align-items:flex-start;font-size:90%}"
    ".grainmotion table{border-collapse:collapse;margin:0}"
    ".grainmotion caption{font-weight:bold;text-align:left;padding:.2em .5em;white-space:nowrap}"
    ".grainmotion td{text-align:left!important;padding:.15em .5em;vertical-align:top;max-width:46em}"
    ".grainmotion td:first-child{opacity:.65;white-space:nowrap}"
    ".grainmotion i{display:inline-block;width:.7em;height:.7em;border-radius:50%;margin-right:.35em}"
    ".grainmotion .count{margin-right:1em;white-space:nowrap}</style>"
)


@dataclass(frozen=True)
class Summary:
    """What is shown of a record: plain text, which is escaped for HTML, and a picture as HTML.

    Attributes
    ----------
    title : str
        What it is.
    line : str
        The rest of its line in a terminal.
    rows : tuple of (str, str)
        Names and values of the table in a notebook.
    picture : str
        An ``<svg>`` or ``<img>`` element; empty for none.
    counts : mapping of str to int
        Number of grains by status.
    """

    title: str
    line: str = ""
    rows: tuple[tuple[str, str], ...] = ()
    picture: str = ""
    counts: Mapping[str, int] = field(default_factory=lambda: NOTHING)

    @property
    def text(self) -> str:
        """The line in a terminal, in angle brackets as no code makes such a record."""
        several = sum(self.counts.values()) > 1
        counted = ", ".join(f"{count} {status}" if several else status for status, count in self.counts.items())
        return f"<{': '.join(part for part in (self.title, '; '.join(filter(None, (counted, self.line)))) if part)}>"

    @property
    def html(self) -> str:
        """The table for a notebook."""
        body = "".join(f"<tr><td>{escape(name)}</td><td>{escape(_short(value))}</td></tr>" for name, value in self.rows)
        if self.counts:
            total = sum(self.counts.values())
            dots = "".join(
                f'<span class="count"><i style="background:{STATUS_COLOURS.get(status, "#888")}"></i>'
                f"{f'{count} ' if total > 1 else ''}{escape(status)}</span>"
                for status, count in self.counts.items()
            )
            body = f"<tr><td>status</td><td>{dots}</td></tr>{body}"
        table = f"<table><caption>{escape(self.title)}</caption><tbody>{body}</tbody></table>"
        return f'{STYLE}<div class="grainmotion">{self.picture}{table}</div>'


class Summarised:
    """A record that shows a `Summary` of itself in place of its arrays."""

    def _summary(self) -> Summary:
        """Fields of a dataclass; records with more to say have their own."""
        assert dataclasses.is_dataclass(self)
        rows = tuple((f.name, value_text(getattr(self, f.name))) for f in dataclasses.fields(self))
        count = f" of {len(self)}" if hasattr(self, "__len__") else ""
        return Summary(type(self).__name__ + count, _short(", ".join(f"{n} {v}" for n, v in rows)), rows)

    def __repr__(self) -> str:
        return self._summary().text

    def _repr_html_(self) -> str:
        return self._summary().html


def value_text(value: object) -> str:
    """A value in a few words: arrays by shape, sequences by length."""
    if isinstance(value, np.ndarray):
        if value.ndim == 0 or value.size <= 3:
            return np.array2string(value, precision=4, separator=", ")
        return f"{' × '.join(map(str, value.shape))} {value.dtype}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str | bytes):
        return _short(str(value))
    if isinstance(value, Mapping):
        return names_text([str(key) for key in value]) if value else "none"
    if isinstance(value, Sequence):
        if len(value) > MAX_ITEMS or any(not isinstance(item, str | int | float) for item in value):
            return f"{len(value)} items"
        return ", ".join(value_text(item) for item in value) or "none"
    return _short(repr(value))


def counted_rows(states: Mapping[str, Mapping[str, int]]) -> tuple[tuple[str, str], ...]:
    """A row a state with its number of grains of each status, the middle ones of many left out."""
    rows = [(name, ", ".join(f"{n} {status}" for status, n in counts.items())) for name, counts in states.items()]
    if len(rows) > MAX_ITEMS:
        rows = [*rows[: MAX_ITEMS - 2], ("…", f"{len(rows) - MAX_ITEMS + 1} more"), rows[-1]]
    return tuple(rows)


def names_text(names: Sequence[str]) -> str:
    """Names, the middle ones of many left out."""
    if len(names) <= MAX_ITEMS:
        return ", ".join(names)
    return f"{', '.join(names[: MAX_ITEMS - 2])}, … {len(names) - MAX_ITEMS + 1} more …, {names[-1]}"


def vector_text(vector: NDArray[np.floating]) -> str:
    """Components with four significant digits."""
    return f"({', '.join(f'{value:.4g}' for value in vector)})"


def shape_text(shape: Sequence[int]) -> str:
    """Sizes with times signs between them."""
    return " × ".join(str(n) for n in shape)


def size_text(count: int) -> str:
    """Bytes in the usual unit."""
    size = float(count)
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= MAX_TEXT else text[: MAX_TEXT - 1] + "…"
