"""Files of ``[section]`` and ``key=value``, as scanners' software writes them on computers of any language."""

from __future__ import annotations

import codecs
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.model.finding import Finding, Level

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
MAX_IMAGES = 1_000_000
"""Larger numbers of images come from damaged files."""
COPY_FROM_SCANNER = "copy the file again from the scanner"


def read_any_text(path: Path) -> str:
    """The text of a file in UTF-8, UTF-16 or Windows' western code page, lines ending in ``\\n``."""
    data = checked_file(path).read_bytes()
    if data.startswith(_UTF16):
        text = data.decode("utf-16", errors="replace")
    elif b"\0" in data:
        raise InputError(str(path), "no text: it holds zero bytes", COPY_FROM_SCANNER)
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def as_number(text: str) -> float | None:
    """The finite number that a text is, with a decimal point or comma; None if it is none."""
    text = text.strip()
    try:
        number = float(text.replace(",", ".") if text.count(",") == 1 and "." not in text else text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


@dataclass(frozen=True)
class KeyFile:
    """A file of sections and keys; both are found in any case.

    Attributes
    ----------
    path : Path
        The file.
    sections : mapping
        From the name of a section, in lower case, to its keys, in lower case, and their texts.  A key that a section
        holds twice has its last text; keys before any section have the section "".
    unended : (str, str), optional
        Section and key of a last line that has no end: where a copy stopped, digits of its number are missing.
    """

    path: Path
    sections: Mapping[str, Mapping[str, str]]
    unended: tuple[str, str] | None = None

    @classmethod
    def read(cls, path: Path) -> KeyFile:
        """Read a file; lines that are neither a section nor a key are passed over."""
        sections: dict[str, dict[str, str]] = {}
        section = ""
        lines = [line.strip() for line in read_any_text(path).split("\n")]
        for line in lines:
            if line.startswith("[") and line.endswith("]"):
                section = line[1:-1].strip().lower()
                sections.setdefault(section, {})
            elif "=" in line and not line.startswith((";", "#")):
                key, _, value = line.partition("=")
                sections.setdefault(section, {})[key.strip().lower()] = value.strip()
        last = lines[-1].partition("=")[0].strip()
        return cls(path, sections, (section, last.lower()) if last else None)

    def where(self, section: str, key: str) -> str:
        """File, section and key, for messages."""
        return f"{self.path} [{section}] {key}"

    def end_findings(self, section: str) -> tuple[Finding, ...]:
        """A warning if the file ends within a line of a section after which every file of the format has others."""
        if self.unended is None or self.unended[0] != section.lower():
            return ()
        fact = f"the file ends within the line '{self.unended[1][:40]}': it is probably truncated, and keys are missing"
        return (Finding(Level.WARNING, "sizes", f"{self.path} [{section}]", fact, remedy=COPY_FROM_SCANNER),)

    def text(self, section: str, key: str) -> str:
        """The text of a key; empty if it is missing."""
        return self.sections.get(section.lower(), {}).get(key.lower(), "")

    def number(self, section: str, key: str) -> float | None:
        """The number of a key; None if the key is missing or empty."""
        text = self.text(section, key)
        if not text:
            return None
        number = as_number(text)
        if number is None:
            raise InputError(self.where(section, key), f"'{text[:40]}' is no number", COPY_FROM_SCANNER)
        if (section.lower(), key.lower()) == self.unended:
            fact = f"the file ends in this line, after '{text[:40]}': digits may be missing"
            raise InputError(self.where(section, key), fact, f"{COPY_FROM_SCANNER}, or end the line")
        return number

    def needed(self, section: str, key: str) -> float:
        """The number of a key that every file of the format has, and that is above zero."""
        number = self.number(section, key)
        if number is None:
            raise InputError(
                self.where(section, key), "it is missing: the file is truncated or altered", COPY_FROM_SCANNER
            )
        if number <= 0:
            raise InputError(self.where(section, key), f"{number:g} is not above 0", COPY_FROM_SCANNER)
        return number

    def count(self, section: str, key: str) -> int:
        """The whole number of a key that tells how many images there are."""
        number = self.needed(section, key)
        if number % 1 or number > MAX_IMAGES:
            fact = f"{number:g} is no number of images"
            raise InputError(self.where(section, key), fact, COPY_FROM_SCANNER)
        return int(number)

    def distances(self, section: str, to_axis: str, to_detector: str) -> tuple[float, float]:
        """Distances from the source to axis and detector, of which the first is the shorter."""
        axis, detector = self.needed(section, to_axis), self.needed(section, to_detector)
        if axis >= detector:
            fact = f"{axis:g} is not below {to_detector} = {detector:g}: the axis lies between source and detector"
            raise InputError(self.where(section, to_axis), fact, "correct the file, both in mm from the source")
        return axis, detector

    def facts(self, labels: Mapping[str, tuple[str, str, str]]) -> tuple[tuple[str, str], ...]:
        """Label and text of the keys that are there, from label to section, key and unit."""
        texts = {label: (self.text(section, key), unit) for label, (section, key, unit) in labels.items()}
        return tuple((label, f"{text} {unit}".strip()) for label, (text, unit) in texts.items() if text)
