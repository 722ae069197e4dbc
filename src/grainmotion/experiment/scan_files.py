"""Where the files of a scan are: from a table of the experiment file, or names in Python, to a `ScanInput`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Beam, Index
from grainmotion.diagnosis import hypotheses
from grainmotion.diagnosis.grey_values import likely_kind
from grainmotion.errors import InputError, InputWarning
from grainmotion.experiment.circular import circular_geometry, scan_angles_deg
from grainmotion.experiment.config import Air, Circular, Kind, ReferenceTable, ScanTable
from grainmotion.experiment.config_errors import input_error
from grainmotion.experiment.file_checks import count_mismatch, file_findings, told_angles_deg
from grainmotion.experiment.recorded import (
    CircularScan,
    Recorded,
    Told,
    beam_monitor,
    recorded_geometry,
    stage_shifts,
)
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.hdf5 import DARK, FLAT, NXtomo
from grainmotion.io.stacks import Stack, find_stack
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan


@checked_arguments
def read_scan(
    radiographs: str | Path | Sequence[str | Path],
    geometry: Geometry | str | Path,
    *,
    flats: str | Path | Sequence[str | Path] | None = None,
    darks: str | Path | Sequence[str | Path] | None = None,
    kind: Kind = "counts",
    beam: Beam = "cone",
    air: Air | None = None,
) -> Scan:
    """Read a scan from files, as a table of the experiment file would.

    Parameters
    ----------
    radiographs : path, glob, ``"file.h5::/path"``, or a list of those
        TIFF, .npy, HDF5 or one NXtomo file, which brings flats and darks unless they are given.
    geometry : Geometry or path
        One view a radiograph, mm; a path names its CSV.
    flats, darks : like ``radiographs``, optional
        Images of the open beam and of no beam; averaged.  Only counts need them.
    kind : {"counts", "transmission", "line-integrals"}
        What the pixels of the radiographs are.
    beam : {"cone", "parallel"}
        Beam of a geometry read from CSV.
    air : Air, optional
        Where the radiographs show only air, ``Air(margin=8)`` or ``Air(region=(0, 20, 0, 20))``.

    Returns
    -------
    Scan
        Line integrals −ln((I − dark)/(flat − dark)), dimensionless, with a mask where pixels are not valid.

    Warns
    -----
    InputWarning
        If radiographs, flats, darks or pixels look wrong, with the likely cause.

    Raises
    ------
    InputError
        If a file is missing or damaged, shapes or numbers of views do not agree, counts come without flats, or
        pixels have values that cannot be; it names the file.
    """
    given = geometry if isinstance(geometry, Geometry) else None
    try:
        table = ReferenceTable(
            radiographs=_names(radiographs),
            flats=_names(flats),
            darks=_names(darks),
            kind=kind,
            beam=beam,
            air=air,
            geometry=None if given is not None else str(geometry),
        )
    except ValidationError as error:
        raise input_error(error, ReferenceTable, {}) from error
    scan, _, findings = find_scan("scan", table, table, Path(), given).read_checked()
    for finding in findings:
        if finding.level is not Level.NOTE:
            warnings.warn(str(finding), InputWarning, stacklevel=2)
    return scan


def _names(files: str | Path | Sequence[str | Path] | None) -> list[str] | None:
    if files is None:
        return None
    return [str(file) for file in ([files] if isinstance(files, str | Path) else files)]


def find_scan(
    key: str, table: ScanTable, reference: ReferenceTable, folder: Path, geometry: Geometry | None = None
) -> ScanInput:
    """Locate one scan; keys missing in its table are the reference's, and ``geometry`` replaces the table's."""
    radiographs = named_stack(f"{key}.radiographs", table.radiographs, folder)
    if radiographs is None:
        raise InputError(f"{key}.radiographs", "it is missing", "name the radiographs")
    kind = table.kind or reference.kind or "counts"
    (count, rows, columns), _ = radiographs.info()
    views = _chosen_views(key, table.views, count)
    nxtomo, recorded, circle = radiographs.nxtomo, list[Finding](), None
    if geometry is None:
        geometry, circle = _find_geometry(key, table, reference, folder, (rows, columns), nxtomo)
        if nxtomo is not None:
            origin = named_stack("reference.radiographs", reference.radiographs, folder)
            motors = reference.motors if table.motors is None else table.motors
            shifts = stage_shifts(key, nxtomo, None if origin is None else origin.nxtomo, motors)
            geometry, found = recorded_geometry(key, nxtomo, Told(geometry, circle, views), shifts)
            recorded += found
    geometry = hypotheses.corrected(geometry, table.fixes)
    angles = told_angles_deg(geometry, None if table.fixes or circle is None else circle.angles_deg)
    if len(geometry) == count and views is not None:
        geometry = geometry[views]
    used = count if views is None else len(views)
    if len(geometry) != used:
        raise count_mismatch(key, table, radiographs, angles, used)
    flats, darks = (_find_beam_images(frames, key, table, reference, folder) for frames in (FLAT, DARK))
    if kind != "counts":
        flats = darks = None
    elif flats is None:
        raise _without_flats(key, radiographs, count)
    for name, stack in (("flats", flats), ("darks", darks)):
        if stack is not None and stack.info()[0][1:] != (rows, columns):
            fact = f"images of {stack.info()[0][1:]} pixels, but the radiographs have {(rows, columns)}"
            raise InputError(f"{stack.spec} ({key}.{name})", fact, f"give {name} of the same camera settings")
    monitor = Recorded()
    if nxtomo is not None and flats is not None:
        monitor = beam_monitor(key, nxtomo, flats.nxtomo)
        recorded += monitor.findings
    stacks = {"radiographs": radiographs, "flats": flats, "darks": darks}
    return ScanInput(
        key=key,
        radiographs=radiographs,
        flats=flats,
        darks=darks,
        kind=kind,
        geometry=geometry,
        views=views,
        air=table.air or reference.air,
        saturation=table.saturation or reference.saturation,
        monitor=monitor.monitor if monitor.monitor is None or views is None else monitor.monitor[views],
        findings=(*recorded, *file_findings(key, table, stacks, angles)),
    )


def _without_flats(key: str, radiographs: Stack, count: int) -> InputError:
    """The error of counts without flats, with the kind that the radiographs look like."""
    found = likely_kind(radiographs.read(np.unique([0, count // 2])))
    if found in ("transmission", "line-integrals"):
        fact = f"it is missing, and {radiographs.spec} looks like {found}, not counts"
        return InputError(f"{key}.flats", fact, f'set {key}.kind = "{found}"')
    return InputError(f"{key}.flats", "it is missing", "give flats, or set kind to what the images are")


def _find_beam_images(frames: int, key: str, table: ScanTable, reference: ReferenceTable, folder: Path) -> Stack | None:
    """Flats or darks: the scan's own files or those in its NXtomo file, else the reference's."""
    name = {FLAT: "flats", DARK: "darks"}[frames]
    for owner, scan in ((key, table), ("reference", reference)):
        stack = named_stack(f"{owner}.{name}", scan.flats if frames == FLAT else scan.darks, folder)
        if stack is not None:
            return stack
        radiographs = named_stack(f"{owner}.radiographs", scan.radiographs, folder)
        nxtomo = None if radiographs is None else radiographs.nxtomo
        if radiographs is not None and nxtomo is not None and nxtomo.count(frames):
            return radiographs.frames(frames)
    return None


def _find_geometry(
    key: str,
    table: ScanTable,
    reference: ReferenceTable,
    folder: Path,
    shape: tuple[int, int],
    nxtomo: NXtomo | None,
) -> tuple[Geometry, CircularScan | None]:
    """The views of a scan: a CSV, a circular scan, or the reference's circle with the angles of an NXtomo file."""
    given = table.geometry
    circle = reference.geometry if isinstance(reference.geometry, Circular) else None
    if given is None and nxtomo is not None and circle is not None:
        given = circle.model_copy(update={"angles_deg": None, "first": None, "last": None, "count": None})
    if given is None:
        raise InputError(f"{key}.geometry", "it is missing", "name a CSV, or give a table for a circular scan")
    inherited: Beam = table.beam or reference.beam or (circle.beam if circle else None) or "cone"
    if isinstance(given, str):
        return read_geometry(folder / given, shape, inherited), None
    try:
        angles = scan_angles_deg(given, folder, nxtomo)
        return circular_geometry(given, given.beam or inherited, shape, angles), CircularScan(given, angles)
    except InputError as error:
        where = error.where if error.where.startswith(str(folder)) else f"{key}.{error.where}"
        raise InputError(where, error.fact, error.remedy) from error


def _chosen_views(key: str, views: str | list[int] | None, count: int) -> Index | None:
    """Indices that "start:stop:step" or a list picks from ``count`` radiographs."""
    if views is None:
        return None
    try:
        if isinstance(views, str):
            numbers = [int(p) if p.strip() else None for p in views.split(":")]
            index = np.arange(count)[slice(*numbers)] if 2 <= len(numbers) <= 3 else np.array([numbers[0]], int)
        else:
            index = np.arange(count)[np.array(views, dtype=int)]
    except (ValueError, TypeError, IndexError) as error:
        fact = f"'{views}' does not pick from {count} radiographs"
        raise InputError(f"{key}.views", fact, 'give "start:stop:step" or a list of indices from 0') from error
    if len(index) == 0 or index.max() >= count:
        raise InputError(f"{key}.views", f"'{views}' picks none of {count} radiographs", "widen the selection")
    return index


def named_stack(key: str, files: list[str] | None, folder: Path) -> Stack | None:
    """The stack behind a key; errors name the file and the key."""
    if files is None:
        return None
    try:
        return find_stack(files if len(files) > 1 else files[0], folder)
    except InputError as error:
        raise InputError(f"{error.where} ({key})", error.fact, error.remedy) from error
