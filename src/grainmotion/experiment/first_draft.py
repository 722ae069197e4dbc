"""A first experiment file from a folder: the scan with the most radiographs is the reference, the others are states."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from grainmotion.diagnosis.file_names import series_of, stem
from grainmotion.errors import InputError
from grainmotion.experiment.config import ExperimentFile
from grainmotion.experiment.folder_contents import FolderContents, ImageSet
from grainmotion.experiment.found_scans import FoundScan, found_scans, lacks_open_beam, missing_keys
from grainmotion.experiment.inherited_keys import with_inherited_keys
from grainmotion.experiment.scan_angles import IN_NAMES, RadiographFiles, scan_angles_deg
from grainmotion.experiment.scan_tables import Circular, ReferenceTable
from grainmotion.io.angles import read_angles
from grainmotion.io.formats import TXRM, family
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.scanners.view_tables import view_file
from grainmotion.io.stacks import find_stack

FULL_SCAN_SHARE = 0.5
"""A later scan with more than this share of the reference's radiographs is a full scan of its own."""
MIN_SCAN = 8
"""Radiographs from which a scan can be the reference."""
_ANGLE_FILE = re.compile(r"ang|theta|rot|deg")
HEADER = """\
# Experiment file of grainmotion, drafted from the folder {folder}.  Lines that begin with # are comments.
# Look at it, fill in what is marked with TODO, then:
#   grainmotion inspect {name}     (draws up and the sense of rotation: look before a long run)
#   grainmotion run {name}
# All keys: docs/experiment.md.  Lengths are in mm, angles in degrees.
"""
CIRCLE = """\
[reference.geometry]
beam = "cone"                    # or "parallel", without the two distances
# source_to_axis = 100.0         # TODO: mm
# source_to_detector = 400.0     # TODO: mm
# pixel_size = 0.1               # TODO: of the panel, mm
# first_row = "top"              # TODO: "top" if row 0 of the images shows the top of the sample, else "bottom"
{angles}
"""
OPEN_BEAM_LINE = '# white_level = 60000            # TODO: count of the open beam, as air has it; or flats = "..."'
_TODO_LINES = ('# beam = "cone"                  # TODO: or "parallel"', *CIRCLE.splitlines())


@dataclass(frozen=True, eq=False)
class Draft:
    """The text of an experiment file, and what has still to be filled in."""

    text: str
    todo: tuple[str, ...]

    @property
    def reference(self) -> ReferenceTable:
        """The table of the reference scan."""
        return ExperimentFile.model_validate(with_inherited_keys(tomllib.loads(self.text))).reference


def draft_experiment(contents: FolderContents, name: str = "experiment.toml") -> Draft:
    """The experiment file of a folder.

    Raises
    ------
    InputError
        If the folder holds no radiographs.
    """
    scans = found_scans(contents)
    if not scans:
        held = [s.sentence for s in contents.images[:4]] + list(contents.problems[:4])
        fact = f"it holds no radiographs{': ' if held else ''}{'; '.join(held)}"
        raise InputError(str(contents.path), fact, "name the folder with the scan and the later radiographs in it")
    reference = max(scans, key=lambda s: s.count)
    if reference.count < MIN_SCAN:
        fact = f"the largest scan, {reference.spec}, has {reference.count} radiographs: none is a full scan"
        raise InputError(str(contents.path), fact, "put the full scan of the initial state into this folder as well")
    states = [scan for scan in scans if scan is not reference]
    lines = [HEADER.format(folder=contents.path.resolve().name, name=name), "[reference]"]
    lines += _images(contents, reference, states)
    todo: list[str] = []
    views = None if reference.file is not None else _view_table(contents, reference)
    if reference.file is not None:
        lines += _told_by_scanner(contents, reference, todo)
    elif views is not None:
        lines += [f'geometry = "{views}"']
    else:
        angles = _angles(contents, reference)
        lines += ["", CIRCLE.format(angles=angles or _one_turn(reference.count)).rstrip()]
        keys = "distances, pixel_size and first_row" if angles else "distances, pixel_size, first_row and angles"
        todo.append(f"[reference.geometry]: {keys}, in the lines with TODO")
    if not states:
        lines += ["", *_example_state()]
        todo.append("[[states]]: the later radiographs, which this folder does not hold")
    taken: set[str] = set()
    for state in states:
        lines += ["", *_state(contents, state, reference, taken, todo)]
    return Draft("\n".join(lines) + "\n", tuple(todo))


def _told_by_scanner(contents: FolderContents, reference: FoundScan, todo: list[str]) -> list[str]:
    """The keys of a reference with a scanner's file: what the file lacks, and its name if the images lie elsewhere."""
    lines, missing = list[str](), missing_keys(contents, reference)
    told = json.dumps(reference.described_by, ensure_ascii=False) if reference.described_by else ""
    if lacks_open_beam(contents, reference):
        lines.append(OPEN_BEAM_LINE)
        todo.append("[reference]: white_level, or flats")
    if told and not missing:
        return [*lines, f"geometry = {told}"]
    mark = "" if missing else "# "
    lines += ["", f"{mark}[reference.geometry]           # only what the scanner's file lacks or tells wrongly"]
    lines += [f"file = {told}"] if told else []
    lines += [next((line for line in _TODO_LINES if line.startswith(f"# {k} =")), f"# {k} = TODO") for k in missing]
    todo += [f"[reference.geometry]: {', '.join(missing)}, in the lines with TODO"] if missing else []
    return lines


def _images(contents: FolderContents, reference: FoundScan, states: Sequence[FoundScan]) -> list[str]:
    """The keys of the reference's images."""
    lines = [f"radiographs = {json.dumps(reference.spec, ensure_ascii=False)}    # {_radiographs(reference.count)}"]
    if reference.file is not None:
        return lines
    kept = [s.folder for s in states if s.folder not in (reference.folder, Path())]
    for role in ("flats", "darks"):
        sets = [s for s in contents.of_role(role) if s.folder not in kept]
        if sets:
            lines.append(f"{role} = {_specs(sets)}")
        else:
            lines.append(f'# {role} = "{role}/*.tif"')
    found = any(contents.of_role("flats"))
    unknown = '# kind = "transmission"         # what pixels are, if not counts: "transmission" or "line-integrals"'
    return lines if found else [*lines, unknown]


def _radiographs(count: int) -> str:
    return "1 radiograph" if count == 1 else f"{count} radiographs"


def _specs(sets: Sequence[ImageSet]) -> str:
    names = [json.dumps(s.spec, ensure_ascii=False) for s in sets]
    return names[0] if len(names) == 1 else f"[{', '.join(names)}]"


def _state(
    contents: FolderContents, state: FoundScan, reference: FoundScan, taken: set[str], todo: list[str]
) -> list[str]:
    """The table of one state."""
    name = state.name
    if name.lower() in taken:
        name = f"{name} {stem(Path(state.spec).name).rstrip('*_-. ')}"
    while name.lower() in taken:
        name += "-2"
    taken.add(name.lower())
    lines = ["[[states]]", f"name = {json.dumps(name, ensure_ascii=False)}"]
    lines.append(f"radiographs = {json.dumps(state.spec, ensure_ascii=False)}    # {_radiographs(state.count)}")
    if state.described_by:
        lines.append(f"geometry = {json.dumps(state.described_by, ensure_ascii=False)}")
    if state.file is None:
        for role in ("flats", "darks"):
            sets = [
                s
                for s in contents.of_role(role)
                if s.folder == state.folder and s.folder not in (reference.folder, Path())
            ]
            lines += [f"{role} = {_specs(sets)}"] if sets else []
        views = _view_table(contents, state)
        angles = _angles(contents, state)
        if views is not None:
            lines.append(f'geometry = "{views}"')
        elif angles is not None:
            lines.append(f"geometry = {{ {angles} }}")
        else:
            named, sure = _angles_in_names(contents, state)
            value, what = ('"names"', f"if {named} in the files' names are the angles") if named else ("[ ]", "")
            what = what or f"the angle of each of the {state.count}"
            row = ', first_row = "top"' if _rows_differ(reference) else ""
            if sure and not row:
                lines.append(f"geometry = {{ angles_deg = {value} }}    # {named}")
            else:
                what += '; "top" as Zeiss exports them' if row else ""
                lines.append(f"# geometry = {{ angles_deg = {value}{row} }}  # TODO: {what}")
                todo.append(f"state '{name}': the angles of its {_radiographs(state.count)}")
    if state.count > FULL_SCAN_SHARE * reference.count:
        lines.append('# views = "::100"     # this state was scanned in full: choose some of its radiographs')
    return lines


def _view_table(contents: FolderContents, scan: FoundScan) -> str | None:
    """A file with whole positions of the views of a scan beside it, of as many views as it has."""
    for name in _tables_of(contents, scan):
        path = contents.path / name
        try:
            views = view_file(path) if path.suffix.lower() != ".xml" else None  # RTK's needs more keys beside it
            if len(views or read_geometry(path, (1, 1))) == scan.count:
                return name
        except InputError:
            continue
    return None


def _one_turn(count: int) -> str:
    """The line for angles that no file tells, with those of one turn to be changed."""
    angles = f"{{ first = 0, last = {360 - 360 / count:.10g}, count = {count} }}"
    return f"# angles_deg = {angles}  # TODO: degrees; this is one turn. Or a list, or a text file"


def _angles(contents: FolderContents, scan: FoundScan) -> str | None:
    """The key for the angles of a scan: a file named after angles that has as many, beside it or in a folder above."""
    above = [name for name in contents.tables if Path(name).parent in scan.folder.parents]
    for name in dict.fromkeys([*_tables_of(contents, scan), *above]):
        if _ANGLE_FILE.search(Path(name).name.lower()) is None:
            continue  # a log of forces has as many rows as well
        try:
            if len(read_angles(contents.path / name)) == scan.count:
                return f"angles_deg = {json.dumps(name, ensure_ascii=False)}"
        except InputError:
            continue
    return None


def _rows_differ(reference: FoundScan) -> bool:
    """Whether images beside a reference probably have row 0 elsewhere: the rows of Zeiss's files run upwards."""
    return reference.file is not None and family(reference.file.path) == TXRM


def _angles_in_names(contents: FolderContents, scan: FoundScan) -> tuple[str, bool]:
    """Numbers in the names of the files that may be the angles, as "0, 45, 90", and whether a word says so."""
    table = Circular(pixel_size=None, first_row=None, angles_deg=IN_NAMES)
    try:
        files = RadiographFiles.of(find_stack(scan.spec, contents.path))
        angles, _ = scan_angles_deg(table, contents.path, files, None)
    except InputError:
        return "", False
    shown = ", ".join(f"{angle:g}" for angle in angles[:4]) + (", ..." if len(angles) > 4 else "")
    return shown, len(series_of(files.names)[0].fields_with_angle_words) == 1


def _tables_of(contents: FolderContents, scan: FoundScan) -> list[str]:
    """Tables whose name holds the scan's, then those in its folder."""
    within = [name for name in contents.tables if Path(name).parent == scan.folder]
    named = [name for name in contents.tables if scan.name.lower() in stem(Path(name).name).lower()]
    return list(dict.fromkeys([*named, *within]))


def _example_state() -> list[str]:
    """A table of a state, to be filled in."""
    return [
        "# [[states]]                   # TODO: one such table for each later state, in loading order",
        '# name = "step-01"',
        '# radiographs = "step-01/*.tif"',
        "# geometry = { angles_deg = [0.0, 45.0, 90.0, 135.0] }",
    ]
