"""The views of a scan: what the experiment file tells, over what the scanner's files tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from grainmotion._typing import Beam, Float, Kind
from grainmotion.errors import InputError
from grainmotion.experiment.circular import circular_geometry, scan_angles_deg
from grainmotion.experiment.config import Circular, ReferenceTable, ScanTable
from grainmotion.experiment.config_errors import input_error
from grainmotion.experiment.inherited_keys import ANGLE_KEYS, TOLD_BY_FILES
from grainmotion.experiment.recorded import CircularScan
from grainmotion.io.files import checked_file
from grainmotion.io.locate import locate
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.identify import is_scanner_file, is_view_file, read_scanner_file, read_views
from grainmotion.io.scanners.view_tables import Panel
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry

MAX_NUMBER_RATIO = 1.02
"""A length of the experiment file that differs by more from the scanner's is probably a mistake in one of them."""


@dataclass(frozen=True, eq=False)
class ScanSources:
    """The tables and files that tell about one scan.

    Attributes
    ----------
    key : str
        ``reference`` or ``states.NAME``.
    table, reference : ScanTable, ReferenceTable
        The scan's own table, and that of the reference.
    folder : Path
        Where relative paths start.
    own, told, origin : ScannerFile, optional
        The scanner's file that the radiographs are, else the one that the geometry names, and that of the reference.
    """

    key: str
    table: ScanTable
    reference: ReferenceTable
    folder: Path
    own: ScannerFile | None = None
    told: ScannerFile | None = None
    origin: ScannerFile | None = None

    @classmethod
    def of(cls, key: str, table: ScanTable, reference: ReferenceTable, folder: Path) -> ScanSources:
        """The tables of a scan, with the scanner's files that they name."""
        own = _scanner_file(key, table, folder)
        told = own or _named_file(key, table, folder)
        origin = told if table is reference else cls.of("reference", reference, reference, folder).told
        return cls(key, table, reference, folder, own, told, origin)

    @property
    def of_reference(self) -> ScanSources:
        """The same for the reference."""
        return ScanSources.of("reference", self.reference, self.reference, self.folder)

    @property
    def files(self) -> tuple[ScannerFile, ...]:
        """The scanner's files that tell about the pixels of this scan, the nearest first."""
        return tuple(file for file in (self.told, self.origin) if file is not None)

    @property
    def kind(self) -> Kind:
        """What the pixels are."""
        own = None if self.told is None else self.told.kind
        origin = None if self.origin is None else self.origin.kind
        return self.table.kind or own or self.reference.kind or origin or "counts"

    @property
    def white_level(self) -> float | None:
        """Count of the open beam, if the counts are divided by flats already."""
        levels = [file.white_level for file in self.files]
        return next((w for w in (self.table.white_level, self.reference.white_level, *levels) if w is not None), None)

    def fallback_beam(self, circle: Circular | None) -> Beam:
        """The kind of beam where neither the circle nor the file with the views tells it."""
        told = self.reference.geometry if isinstance(self.reference.geometry, Circular) else None
        return self.table.beam or self.reference.beam or (told.beam if told else None) or _file_beam(self) or "cone"


def find_views(sources: ScanSources, shape: tuple[int, int]) -> tuple[Geometry, CircularScan | None]:
    """The views of a scan on a panel of ``shape`` pixels, and its circle if they follow from one."""
    given, own = sources.table.geometry, sources.own
    if isinstance(given, str):
        given = Circular(file=given, pixel_size=None, first_row=None)
    if given is None and own is not None and own.views is not None:
        return own.placed(_on_panel(own.views, shape, own)), None
    name = None if given is None else given.file
    if given is not None and name is not None:
        path, key = checked_file(sources.folder / name), f"{sources.key}.geometry"
        if is_view_file(path):
            beam = given.beam or sources.fallback_beam(given)
            return read_views(path, Panel(shape, given.pixel_size, given.first_row, beam)), None  # of images as stored
        if not is_scanner_file(name):
            raise InputError(f"{path} ({key})", "it is no file with the views of a scan", "see docs/scanners.md")
        own = _read(path, key)
        if own.views is not None:
            return own.placed(_on_panel(own.views, shape, own)), None
    circle = _circle(sources, given, own)
    try:
        angles = scan_angles_deg(circle, sources.folder, None if own is None else own.circle.angles_deg)
        beam = circle.beam or sources.fallback_beam(circle)
        geometry = circular_geometry(circle, beam, shape, angles)
    except InputError as error:
        where = error.where if error.where.startswith(str(sources.folder)) else f"{sources.key}.{error.where}"
        raise InputError(where, error.fact, error.remedy) from error
    return _placed(geometry, own, sources.origin), CircularScan(circle, angles)


def overridden(sources: ScanSources, circle: CircularScan | None) -> tuple[Finding, ...]:
    """Numbers of the scanner's file that the experiment file overrides; lengths that differ much are doubtful."""
    own = sources.told or sources.origin
    if own is None or circle is None:
        return ()
    found = []
    for name, value in own.circle.known.items():
        told = getattr(circle.table, name)
        if told is None or told == value:
            continue
        where = f"{sources.key}.geometry.{name}"
        fact = f"{told} of the experiment file is used, not {value} of {own.path.name}"
        level, remedy = Level.NOTE, ""
        if isinstance(value, float) and isinstance(told, float) and value > 0:
            if 1 / MAX_NUMBER_RATIO < told / value < MAX_NUMBER_RATIO:
                continue
            level, remedy = Level.WARNING, "leave the key out unless the scanner's file is known to be wrong"
        found.append(Finding(level, "sizes", where, fact, remedy=remedy))
    return tuple(found)


def _circle(sources: ScanSources, given: Circular | None, own: ScannerFile | None) -> Circular:
    """The numbers of a circular scan: those of the files, then of the reference's table, then of the scan's own."""
    told = sources.reference.geometry if isinstance(sources.reference.geometry, Circular) else None
    numbers: dict[str, object] = dict.fromkeys(TOLD_BY_FILES)
    for file in (sources.origin, own):
        numbers |= {} if file is None else file.circle.known
    if (beam := sources.table.beam or sources.reference.beam) is not None:
        numbers["beam"] = beam
    if told is not None:
        numbers |= {k: v for k, v in _set_keys(told).items() if k not in (*ANGLE_KEYS, "file")}
    if given is not None:
        numbers |= _set_keys(given)
    told_by_file = own is not None and (own.circle.angles_deg is not None or bool(own.circle.known))
    if given is None and not told_by_file and (own is None or told is None):
        raise InputError(
            f"{sources.key}.geometry",
            "it is missing",
            "name a file with the views, or give a table for a circular scan",
        )
    try:
        return Circular.model_validate(numbers)
    except ValidationError as error:
        assert own is not None
        raise InputError(str(own.path), f"{input_error(error, Circular, numbers).fact}", "correct the file") from error


def _placed(geometry: Geometry, own: ScannerFile | None, origin: ScannerFile | None) -> Geometry:
    """A circular scan as its file places the images; bare images of a state are mirrored as the reference's."""
    if own is None and origin is not None:
        own = replace(origin, image_shifts=None)
    return geometry if own is None else own.placed(geometry)


def _set_keys(table: Circular) -> dict[str, object]:
    """The keys of a table that the experiment file gives."""
    return {name: getattr(table, name) for name in table.model_fields_set if getattr(table, name) is not None}


def _scanner_file(key: str, table: ScanTable, folder: Path) -> ScannerFile | None:
    """The scanner's file that the radiographs of a table are, if they are one."""
    if table.radiographs is None or len(table.radiographs) != 1 or not is_scanner_file(table.radiographs[0]):
        return None
    key = f"{key}.radiographs"
    try:
        files = locate(table.radiographs[0], folder).files
    except InputError as error:
        raise InputError(f"{error.where} ({key})", error.fact, error.remedy) from error
    return _read(files[0], key) if len(files) == 1 else None


def _named_file(key: str, table: ScanTable, folder: Path) -> ScannerFile | None:
    """The scanner's file that the geometry of a table names, if it names one."""
    name = table.geometry.file if isinstance(table.geometry, Circular) else table.geometry
    if name is None or not is_scanner_file(name) or is_view_file(checked_file(folder / name)):
        return None
    return _read(folder / name, f"{key}.geometry")


def _read(path: Path, key: str) -> ScannerFile:
    """A scanner's file; errors name it and the key."""
    folders = [path.parent, *(item for item in path.parent.iterdir() if item.is_dir())]  # where its images may lie
    times = tuple(folder.stat().st_mtime_ns for folder in folders)
    status = path.stat()
    try:
        return _cached(path, (status.st_mtime_ns, *times), status.st_size)
    except InputError as error:
        raise InputError(f"{error.where} ({key})", error.fact, error.remedy) from error


@lru_cache(maxsize=32)
def _cached(path: Path, modified: tuple[int, ...], size: int) -> ScannerFile:
    """A scanner's file as it and its folders were at a time: a reference's is asked for by every state."""
    return read_scanner_file(path)


def _on_panel(views: Geometry, shape: tuple[int, int], own: ScannerFile) -> Geometry:
    """Views of a file, if its panel is that of the images."""
    if views.shape != shape:
        fact = f"a panel of {views.shape} pixels, but the images have {shape}"
        raise InputError(str(own.path), fact, "give the images of that scan, neither binned nor cropped")
    return views


def _file_beam(sources: ScanSources) -> Beam | None:
    """The kind of beam that the scanner's files tell."""
    return next((file.circle.beam for file in sources.files if file.circle.beam is not None), None)


def recorded_levels(own: ScannerFile | None) -> Float | None:
    """−ln of the beam in each view over that of the flats, if the scanner's file holds it."""
    return None if own is None or own.beam_levels is None else -np.log(own.beam_levels)
