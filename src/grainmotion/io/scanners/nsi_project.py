"""The text of North Star Imaging's ``.nsipro``: sections in XML's manner, whose values have no closing tags."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.key_file import read_any_text

_TAG = re.compile(r"<(?P<end>/?)(?P<name>[^<>/][^<>]*)>(?P<value>.*)")


@dataclass(frozen=True, eq=False)
class NsiProject:
    """The values of a project.

    Attributes
    ----------
    path : Path
        The file.
    values : mapping of (str, str) to str
        By the name of any section around a tag, and of the tag; of several, the first.
    """

    path: Path
    values: Mapping[tuple[str, str], str]

    def text(self, section: str, name: str) -> str:
        """The value of a tag; empty if it is missing."""
        return self.values.get((section, name), "")

    def numbers(self, section: str, name: str, length: int) -> Float:
        """The first ``length`` numbers of a tag."""
        text = self.values.get((section, name))
        if text is None:
            fact = f"<{name}> of the section <{section}> is missing"
            remedy = "the file is truncated, or of a scan that was not finished: export it again"
            raise InputError(str(self.path), fact, remedy)
        try:
            numbers = np.array([float(word) for word in text.split()])
        except ValueError:
            numbers = np.array([np.nan])
        if len(numbers) < length or not np.isfinite(numbers).all():
            fact = f"<{name}> of the section <{section}> is '{text}', not {length} number{'s' if length > 1 else ''}"
            raise InputError(str(self.path), fact, "correct it, or export the file again")
        return numbers[:length]

    def whole(self, section: str, name: str) -> int:
        """A positive whole number of a tag."""
        number = float(self.numbers(section, name, 1)[0])
        if number < 1 or number != int(number):
            fact = f"<{name}> of the section <{section}> is {number:.6g}, not a positive whole number"
            raise InputError(str(self.path), fact, "correct it, or export the file again")
        return int(number)

    def flag(self, section: str, name: str) -> bool:
        """A tag that is True or False."""
        text = self.text(section, name)
        if text not in ("True", "False"):
            fact = f"<{name}> of the section <{section}> is '{text}', not True or False"
            raise InputError(str(self.path), fact, f"add <{name}> to the section, or export the file again")
        return text == "True"


def read_nsi_project(path: Path) -> NsiProject:
    """The values of a ``.nsipro`` file."""
    values: dict[tuple[str, str], str] = {}
    sections: list[str] = []
    lines = [match for line in read_any_text(path).split("\n") if (match := _TAG.search(line))]
    closed = {match["name"].strip() for match in lines if match["end"]}
    for match in lines:
        name, value = match["name"].strip(), match["value"].strip()
        if match["end"]:
            if name in sections:
                del sections[sections.index(name) :]
        elif name in closed and not value:
            sections.append(name)
        else:
            for section in sections:
                values.setdefault((section, name), value.removesuffix(f"</{name}>").strip())
    if "NSI Reconstruction Project" not in {match["name"].strip() for match in lines}:
        fact = "not a project of North Star Imaging's software: it does not begin with <NSI Reconstruction Project>"
        raise InputError(str(path), fact, "give the .nsipro file of a scan")
    return NsiProject(path, values)
