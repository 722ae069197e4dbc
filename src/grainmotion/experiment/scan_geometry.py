"""The views of a scan: what the experiment file tells, over what the scanner's files tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from grainmotion._typing import Beam, Float, Kind
from grainmotion.errors import InputError
from grainmotion.experiment.circular import circular_geometry
from grainmotion.experiment.config_errors import input_error
from grainmotion.experiment.inherited_keys import ANGLE_KEYS, TOLD_BY_FILES
from grainmotion.experiment.recorded import CircularScan
from grainmotion.experiment.scan_angles import RadiographFiles, scan_angles_deg
from grainmotion.experiment.scan_tables import Circular, ReferenceTable, ScanTable
from grainmotion.io.files import checked_file
from grainmotion.io.formats import TXRM, family
from grainmotion.io.locate import locate
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.scanners.identify import (
    is_scanner_file,
    is_view_file,
    read_scanner_file,
    read_views,
    scanner_files_beside,
)
from grainmotion.io.scanners.joined import joined_scan
from grainmotion.io.scanners.view_panel import Panel
from grainmotion.io.scanners.view_tables import keys_beside_views
from grainmotion.io.stacks import Stack
from grainmotion.model.geometry import Geometry


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
    def rows_of_own_images(self) -> ScannerFile | None:
        """The reference's file if it tells the rows of the images in it alone: Zeiss's, whose exports differ."""
        if self.origin is None or family(self.origin.path) != TXRM:
            return None
        why = "it tells the rows of its own images, and TIFF that Zeiss's software exports has row 0 at the top"
        return replace(self.origin, unclear=(("first_row", why),))

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


def find_views(sources: ScanSources, radiographs: Stack) -> tuple[Geometry, CircularScan | None]:
    """The views of a scan on the panel of its radiographs, and its circle if they follow from one."""
    shape = radiographs.info()[0][1:]
    given, own = sources.table.geometry, sources.own
    if isinstance(given, str):
        given = Circular(file=given, pixel_size=None, first_row=None)
    if given is None and own is not None and own.views is not None:
        return own.placed(_on_panel(own.views, shape, own)), None
    name = None if given is None else given.file
    if given is not None and name is not None:
        path, key = checked_file(sources.folder / name), f"{sources.key}.geometry"
        if is_view_file(path):
            _check_keys(sources, given)
            beam = given.beam or sources.fallback_beam(given)
            panel = Panel(shape, given.pixel_size, given.first_row, beam, given.detector_offset)
            return _between(read_views(path, panel), f"{path} ({key})"), None  # of images as stored
        if not is_scanner_file(name):
            raise InputError(f"{path} ({key})", "it is no file with the views of a scan", "see docs/scanners.md")
        own = _read(path, key)
        if own.views is not None:
            return own.placed(_on_panel(own.views, shape, own)), None
    keys = set() if given is None else _set_keys(given).keys()
    if own is not None and own.views is not None and not own.circle.known and not keys & set(ANGLE_KEYS):
        key = f"{sources.key}.geometry.{next(iter(keys), '')}".rstrip(".")
        fact = f"it has no effect beside {own.path.name}, whose views are on no circle"
        raise InputError(key, fact, "leave it out, or give all of a circular scan with its angles")
    circle = _circle(sources, given, own)
    try:
        recorded = None if own is None else own.circle.angles_deg
        angles, found = scan_angles_deg(circle, sources.folder, RadiographFiles.of(radiographs), recorded)
        beam = circle.beam or sources.fallback_beam(circle)
        geometry = circular_geometry(circle, beam, shape, angles)
    except InputError as error:
        where = error.where if error.where.startswith(str(sources.folder)) else f"{sources.key}.{error.where}"
        raise InputError(
            where, _explained(error.where, error.fact, own or sources.rows_of_own_images), error.remedy
        ) from error
    found = tuple(replace(f, where=f"{sources.key}.{f.where}") for f in found)
    return _placed(geometry, own, sources.origin), CircularScan(circle, angles, found)


def _between(views: Geometry, where: str) -> Geometry:
    """Views of a file, if the origin lies before the panel as the source sees it."""
    if views.beam == "cone" and views.pixel_at((0, 0, 0)) <= 0:
        fact = "the rotation axis, at the origin, is not between source and panel"
        raise InputError(where, fact, "check the signs of sx sy sz and dx dy dz")
    return views


def _explained(where: str, fact: str, own: ScannerFile | None) -> str:
    """The fact that a key is missing, with what the scanner's file says instead of it."""
    why = [] if own is None else [text for key, text in own.unclear if where == f"geometry.{key}"]
    return f"{fact}; {own.path.name} does not tell it: {why[0]}" if own is not None and why else fact


def _circle(sources: ScanSources, given: Circular | None, own: ScannerFile | None) -> Circular:
    """The numbers of a circular scan: those of the files, then of the reference's table, then of the scan's own."""
    told = sources.reference.geometry if isinstance(sources.reference.geometry, Circular) else None
    numbers: dict[str, object] = dict.fromkeys(TOLD_BY_FILES)
    for file in (sources.origin, own):
        numbers |= {} if file is None else file.circle.known
    if own is None and sources.rows_of_own_images is not None:
        numbers["first_row"] = None
    if (beam := sources.table.beam or sources.reference.beam) is not None:
        numbers["beam"] = beam
    if told is not None:
        numbers |= {k: v for k, v in _set_keys(told).items() if k not in (*ANGLE_KEYS, "file")}
    if given is not None:
        numbers |= _set_keys(given)
    _complete(numbers, sources, own)
    told_by_file = own is not None and (own.circle.angles_deg is not None or bool(own.circle.known))
    if given is None and not told_by_file and (own is None or told is None):
        remedy = "name a file with the views, or give a table for a circular scan"
        if told is not None and sources.table is not sources.reference:
            remedy = "give its angles: geometry = { angles_deg = [0, 45, 90, 135] }; it has the reference's other keys"
        beside = [f for name in sources.table.radiographs or [] for f in scanner_files_beside(name, sources.folder)]
        remedy += f'; or name the scanner\'s file: radiographs = "{beside[0]}"' if beside else ""
        raise InputError(f"{sources.key}.geometry", "it is missing", remedy)
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


def _check_keys(sources: ScanSources, given: Circular) -> None:
    """Refuse keys of a circle beside a file of views, unless they are inherited."""
    told = sources.reference.geometry if isinstance(sources.reference.geometry, Circular) else None
    inherited = {} if told is None or sources.table is sources.reference else _set_keys(told)
    for name, value in _set_keys(given).items():
        if name not in keys_beside_views(Path(given.file or "")) and inherited.get(name) != value:
            fact = f"it has no effect beside {given.file}, which holds whole positions"
            raise InputError(f"{sources.key}.geometry.{name}", fact, "leave it out")


def _complete(numbers: dict[str, object], sources: ScanSources, own: ScannerFile | None) -> None:
    """Add the panel's distance where the files tell it from the axis, and refuse distances in a parallel beam."""
    file = own or sources.origin
    source, panel = numbers.get("source_to_axis"), numbers.get("source_to_detector")
    if file is None or not isinstance(source, float):
        return
    if panel is None and file.axis_to_detector is not None:
        numbers["source_to_detector"] = source + file.axis_to_detector
    if numbers.get("beam") == file.circle.beam == "parallel" and file.circle.source_to_axis is None:
        fact = f"it is given, but {file.path.name} is of a parallel beam"
        remedy = 'set beam = "cone" if the source is near, else leave the distances out'
        raise InputError(f"{sources.key}.geometry.source_to_axis", fact, remedy)


def _set_keys(table: Circular) -> dict[str, object]:
    """The keys of a table that the experiment file gives."""
    return {name: getattr(table, name) for name in table.model_fields_set if getattr(table, name) is not None}


def _scanner_file(key: str, table: ScanTable, folder: Path) -> ScannerFile | None:
    """The scanner's file that the radiographs of a table are, or several of them that hold a part each."""
    names = table.radiographs
    if not names or not all(map(is_scanner_file, names)):
        return None
    key = f"{key}.radiographs"
    try:
        files = [file for name in names for file in locate(name, folder).files]
        if len(files) > 1 and all(family(file) == TXRM for file in files):
            return joined_scan([_read(file, key) for file in files])
    except InputError as error:
        where = error.where if key in error.where else f"{error.where} ({key})"
        raise InputError(where, error.fact, error.remedy) from error
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
