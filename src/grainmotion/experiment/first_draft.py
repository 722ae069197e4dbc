"""A first experiment file from a folder: the scan with the most radiographs is the reference, the others are states."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from grainmotion.diagnosis.file_names import natural_order, stem
from grainmotion.errors import InputError
from grainmotion.experiment.config import ExperimentFile
from grainmotion.experiment.folder_contents import FolderContents, ImageSet
from grainmotion.experiment.inherited_keys import with_inherited_keys
from grainmotion.experiment.scan_angles import IN_NAMES, RadiographFiles, scan_angles_deg
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import Circular, ReferenceTable
from grainmotion.io.angles import read_angles
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.scanners.description import ScannerFile
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
_TODO_LINES = ('# beam = "cone"                  # TODO: or "parallel"', *CIRCLE.splitlines())
_ABSENT_KEY = re.compile(r"geometry\.(\w+): it is missing")


@dataclass(frozen=True, eq=False)
class FoundScan:
    """Radiographs of one state, as a folder holds them."""

    name: str  # for the state
    spec: str
    count: int  # radiographs; 0 if unknown
    file: ScannerFile | None = None  # of the scanner, if it is one

    @property
    def folder(self) -> Path:
        """Folder of the scan, from the folder that was looked into."""
        return Path(self.spec).parent


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
    scans = _scans(contents)
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
        missing = _missing_keys(contents, reference)
        mark = "" if missing else "# "
        lines += ["", f"{mark}[reference.geometry]           # only what the scanner's file lacks or tells wrongly"]
        lines += [next((line for line in _TODO_LINES if line.startswith(f"# {k} =")), f"# {k} = TODO") for k in missing]
        todo += [f"[reference.geometry]: {', '.join(missing)}, in the lines with TODO"] if missing else []
    elif views is not None:
        lines += [f'geometry = "{views}"']
    else:
        lines += ["", CIRCLE.format(angles=_angles(contents, reference) or "# angles_deg = TODO").rstrip()]
        todo.append("[reference.geometry]: distances, pixel_size and first_row, in the lines with TODO")
    if not states:
        lines += ["", *_example_state()]
        todo.append("[[states]]: the later radiographs, which this folder does not hold")
    taken: set[str] = set()
    for state in states:
        lines += ["", *_state(contents, state, reference, taken, todo)]
    return Draft("\n".join(lines) + "\n", tuple(todo))


def _missing_keys(contents: FolderContents, scan: FoundScan) -> list[str]:
    """Keys of the geometry without which the scan of a scanner's file cannot be used."""
    table = ReferenceTable(radiographs=[scan.spec])
    try:
        find_scan("reference", table, table, contents.path)
    except InputError as error:
        return list(dict.fromkeys(_ABSENT_KEY.findall(str(error))))
    return []


def _scans(contents: FolderContents) -> list[FoundScan]:
    """All scans of the folder in the order of the numbers in their paths."""
    scans = [FoundScan(_name(spec), spec, _count(file), file) for spec, file in contents.scans]
    radiographs = [s for s in contents.of_role("radiographs") if not _is_beside_scan(contents, s)]
    scans += [FoundScan(_name(s.spec), s.spec, s.shape[0]) for s in radiographs]
    return [scans[k] for k in natural_order([scan.spec for scan in scans])]


def _is_beside_scan(contents: FolderContents, images: ImageSet) -> bool:
    """Whether images are previews or slices of a scanner's scan: beside its radiographs, and named as they begin."""
    first = [Path(file.radiographs[0]) for _, file in contents.scans if file.radiographs]
    begins = [(path.parent, re.sub(r"[\d_ -]+$", "", path.stem)) for path in first]
    place = (contents.path / images.spec).absolute()
    return any(place.parent == folder and place.name.startswith(name) for folder, name in begins if name)


def _count(file: ScannerFile) -> int:
    """Number of radiographs of a scanner's file."""
    if file.circle.angles_deg is not None:
        return len(file.circle.angles_deg)
    if file.views is not None:
        return len(file.views)
    try:
        return find_stack(list(file.radiographs), file.path.parent).info()[0][0] if file.radiographs else 0
    except InputError:
        return 0


def _name(spec: str) -> str:
    """A name for a state: that of its folder, or of its file."""
    folder = Path(spec).parent.name
    name = folder or re.sub(r"[_\-. ]*\*$", "", stem(Path(spec).name)) or "state"
    return re.sub(r'[/\\:*?"<>|\x00-\x1f]', "-", name).lstrip("_-. ") or "state"


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
            named = _angles_in_names(contents, state)
            value, what = ('"names"', f"if {named} in the files' names are the angles") if named else ("[ ]", "")
            what = what or f"the angle of each of the {state.count}"
            lines.append(f"# geometry = {{ angles_deg = {value} }}  # TODO: {what}")
            todo.append(f"state '{name}': the angles of its {_radiographs(state.count)}")
    if state.count > FULL_SCAN_SHARE * reference.count:
        lines.append('# views = "::100"     # this state was scanned in full: choose some of its radiographs')
    return lines


def _view_table(contents: FolderContents, scan: FoundScan) -> str | None:
    """A file with whole positions of the views of a scan beside it, of as many views as it has."""
    for name in _tables_of(contents, scan):
        try:
            if len(read_geometry(contents.path / name, (1, 1))) == scan.count:
                return name
        except InputError:
            continue
    return None


def _angles(contents: FolderContents, scan: FoundScan) -> str | None:
    """The key for the angles of a scan: a file beside it that is named after angles and has as many as it."""
    for name in _tables_of(contents, scan):
        if _ANGLE_FILE.search(Path(name).name.lower()) is None:
            continue  # a log of forces has as many rows as well
        try:
            if len(read_angles(contents.path / name)) == scan.count:
                return f"angles_deg = {json.dumps(name, ensure_ascii=False)}"
        except InputError:
            continue
    return None


def _angles_in_names(contents: FolderContents, scan: FoundScan) -> str:
    """Numbers in the names of the files that may be the angles, as "0, 45, 90"; empty if there are none."""
    table = Circular(pixel_size=None, first_row=None, angles_deg=IN_NAMES)
    try:
        files = RadiographFiles.of(find_stack(scan.spec, contents.path))
        angles, _ = scan_angles_deg(table, contents.path, files, None)
    except InputError:
        return ""
    return ", ".join(f"{angle:g}" for angle in angles[:4]) + (", ..." if len(angles) > 4 else "")


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
