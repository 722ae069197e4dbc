"""What a folder of measurements holds: scanners' files, series of images, tables of views and angles, experiments."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from grainmotion.diagnosis.file_names import natural_order, series_of, stem
from grainmotion.errors import InputError
from grainmotion.io.formats import HDF5, family
from grainmotion.io.locate import INSPECTION_PICTURE
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.identify import is_described_elsewhere, is_scanner_file, read_scanner_file
from grainmotion.io.scanners.view_tables import view_file
from grainmotion.io.stacks import Stack, find_stack

Role = Literal["radiographs", "flats", "darks"]

MAX_FOLDER_DEPTH = 3
"""Folders below the given one that are looked into."""
MAX_FILES_LOOKED_AT = 200_000
RESULT_MARK = "stages.json"
"""A folder with this file holds results of a run."""
_FLATS = re.compile(r"(^|[^a-z])(flat|flats|ff|white|whites|bright|open|openbeam|ob|gain|i0|brightfield)([^a-z]|$)")
_DARKS = re.compile(r"(^|[^a-z])(dark|darks|df|offset|offsets|black|darkfield)([^a-z]|$)")
TABLE_SUFFIXES = (".csv", ".txt", ".ang", ".geom")


@dataclass(frozen=True, eq=False)
class ImageSet:
    """Images that belong together, by their names.

    Attributes
    ----------
    spec : str
        Path or pattern from the folder, as the experiment file takes it.
    files : int
        Number of files.
    shape : (int, int, int)
        Images, rows, columns; (0, 0, 0) if they cannot be read.
    dtype : str
        Number type.
    role : {"radiographs", "flats", "darks"}
        By the names of folder and files.
    problem : str
        Why they cannot be read; else empty.
    """

    spec: str
    files: int
    shape: tuple[int, int, int]
    dtype: str
    role: Role
    problem: str = ""

    @property
    def folder(self) -> Path:
        """Folder of the files, from the folder that was looked into."""
        return Path(self.spec).parent

    @property
    def sentence(self) -> str:
        """The set in one line."""
        if self.problem:
            return f"{self.spec}: {self.problem}"
        size = " x ".join(map(str, self.shape))
        return f"{self.spec}: {size} (images, rows, columns) {self.dtype}, {self.role}"


@dataclass(frozen=True, eq=False)
class FolderContents:
    """What a folder and those in it hold; paths start at the folder."""

    path: Path
    scans: tuple[tuple[str, ScannerFile], ...] = ()
    images: tuple[ImageSet, ...] = ()
    tables: tuple[str, ...] = ()  # files that may hold views or angles
    experiments: tuple[str, ...] = ()
    results: tuple[str, ...] = ()  # folders with results of a run
    problems: tuple[str, ...] = ()  # scanners' files that cannot be used, and why
    others: dict[str, int] = field(default_factory=dict)  # number of other files by their suffix

    def of_role(self, role: Role) -> tuple[ImageSet, ...]:
        """The sets of images of one role that can be read."""
        return tuple(s for s in self.images if s.role == role and not s.problem)


def folder_contents(folder: Path) -> FolderContents:
    """Look into a folder and up to `MAX_FOLDER_DEPTH` below it; only headers of images are read.

    Hidden folders are left out, and of folders with results of a run all but their names.  Images that a scanner's file
    refers to belong to it.
    """
    (files, results), problems = _files(folder), list[str]()
    scans: list[tuple[str, ScannerFile]] = []
    owned: set[Path] = set()
    for path in files:
        name = path.relative_to(folder).as_posix()
        if is_described_elsewhere(path):
            owned.add(path.absolute())
        if not is_scanner_file(name) or path.absolute() in owned:
            continue
        try:
            scan = read_scanner_file(path)
        except InputError as error:
            if family(path) != HDF5:
                problems.append(f"{name}: {error.fact}; {error.remedy}")
            continue
        twin = next((n for n, s in scans if s.radiographs and s.radiographs == scan.radiographs), None)
        if twin is not None:
            problems.append(f"{name}: it describes the same radiographs as {twin}; that was taken, see which is right")
            continue
        scans.append((name, scan))
        owned |= {p.absolute() for p in (path, *_images_of(scan))}
    files = [p for p in files if p.absolute() not in owned]
    views = [p for p in files if _holds_views(p)]
    images = _image_sets(folder, [p for p in files if family(p) not in (None, HDF5) and p not in views])
    rest = [p for p in files if family(p) is None or p in views]
    names = [p.relative_to(folder).as_posix() for p in rest]
    tables = [n for p, n in zip(rest, names, strict=True) if p.suffix.lower() in TABLE_SUFFIXES or p in views]
    experiments = [n for n in names if n.endswith(".toml")]
    others = Counter(Path(n).suffix.lower() or "no suffix" for n in names if n not in (*tables, *experiments))
    order = natural_order([name for name, _ in scans])
    return FolderContents(
        folder,
        tuple(scans[k] for k in order),
        tuple(images),
        tuple(tables[k] for k in natural_order(tables)),
        tuple(experiments),
        tuple(place.relative_to(folder).as_posix() for place in results),
        tuple(problems),
        dict(others),
    )


def _holds_views(path: Path) -> bool:
    """Whether a file holds ASTRA's vectors or RTK's geometry, which no table of numbers is taken for."""
    try:
        return view_file(path) is not None
    except InputError:
        return False


def _files(folder: Path) -> tuple[list[Path], list[Path]]:
    """The files of a folder and of those in it, in the order of the numbers in their names; folders of results."""
    found: list[Path] = []
    results: list[Path] = []
    level = [folder]
    for _ in range(MAX_FOLDER_DEPTH + 1):
        below: list[Path] = []
        for place in level:
            try:
                items = [item for item in place.iterdir() if not item.name.startswith(".")]
            except OSError as error:
                fact = f"the folder cannot be read: {error.strerror}"
                raise InputError(str(place), fact, "name a folder that you may read") from error
            if any(item.name == RESULT_MARK for item in items):
                results.append(place)
                continue
            items = [item for item in items if item.name != INSPECTION_PICTURE]
            items = [items[k] for k in natural_order([item.name for item in items])]
            found += [item for item in items if item.is_file() and item.stat().st_size > 0]
            below += [item for item in items if item.is_dir()]
        if len(found) > MAX_FILES_LOOKED_AT:
            fact = f"it holds more than {MAX_FILES_LOOKED_AT} files"
            raise InputError(str(folder), fact, "name the folder of one experiment")
        level = below
    return found, results


def _images_of(scan: ScannerFile) -> list[Path]:
    """The image files that a scanner's file refers to; none where they are missing."""
    found: list[Path] = []
    for specs in (scan.radiographs, scan.flats, scan.darks):
        try:
            found += find_stack(list(specs), scan.path.parent).files if specs else ()
        except InputError:
            continue
    return found


def _image_sets(folder: Path, files: Sequence[Path]) -> list[ImageSet]:
    """Images by their folder and the text of their names around the numbers."""
    sets: list[ImageSet] = []
    for place in dict.fromkeys(p.parent for p in files):
        within = [p for p in files if p.parent == place]
        for suffix in dict.fromkeys(p.suffix for p in within):
            names = [p.name for p in within if p.suffix == suffix]
            groups = _groups(names)
            for pattern, count in groups:
                one_of_all = len(groups) == 1 and len(names) > 1 and len({p.suffix for p in within}) == 1
                name = f"*{suffix}" if one_of_all else pattern
                spec = (place.relative_to(folder) / name).as_posix()
                sets.append(_image_set(folder, spec, count))
    order = natural_order([s.spec for s in sets])
    return [sets[k] for k in order]


def _groups(names: Sequence[str]) -> list[tuple[str, int]]:
    """Patterns of the series among names, with the number of names of each; a single file has its own name."""
    groups: dict[str, list[str]] = {}
    for series in series_of(names):
        members = [names[k] for k in series.places]
        if series.texts and len(members) > 1 and len(series.texts) > 1:
            groups.setdefault(f"{series.texts[0]}*{series.texts[-1]}{series.suffix}", []).extend(members)
        else:
            for name in members:
                groups.setdefault(name, []).append(name)
    return [(pattern, len(members)) for pattern, members in groups.items()]


def _image_set(folder: Path, spec: str, count: int) -> ImageSet:
    """A set of images, with its size from the headers of the first and last file."""
    words = (Path(spec).parent.name + " " + stem(Path(spec).name)).lower().replace("_", " ")
    role: Role = "darks" if _DARKS.search(words) else "flats" if _FLATS.search(words) else "radiographs"
    try:
        stack = find_stack(spec, folder)
        shape, dtype = _quick_info(stack)
    except InputError as error:
        return ImageSet(spec, count, (0, 0, 0), "", role, error.fact)
    return ImageSet(spec, len(stack.files), shape, str(dtype), role)


def _quick_info(stack: Stack) -> tuple[tuple[int, int, int], object]:
    """Shape and type of a stack whose files have one image each, or all headers if the first has several."""
    if len(stack.parts) < 3:
        return stack.info()
    ends = replace(stack, parts=(stack.parts[0], stack.parts[-1]))
    (count, rows, columns), dtype = ends.info()
    return ((len(stack.parts), rows, columns), dtype) if count == 2 else stack.info()
