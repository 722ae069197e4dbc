"""Where the files of a scan are: from a table of the experiment file, or names in Python, to a `ScanInput`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Beam, Index, Kind
from grainmotion.diagnosis import hypotheses
from grainmotion.diagnosis.grey_values import likely_kind
from grainmotion.errors import InputError, InputWarning
from grainmotion.experiment.config_errors import input_error
from grainmotion.experiment.file_checks import axis_findings, count_mismatch, file_findings, told_angles_deg
from grainmotion.experiment.inherited_keys import ANGLE_KEYS
from grainmotion.experiment.overridden_numbers import overridden
from grainmotion.experiment.recorded import (
    Told,
    beam_monitor,
    recorded_geometry,
    stage_shifts,
)
from grainmotion.experiment.scan_geometry import ScanSources, find_views, recorded_levels
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import Circular, ReferenceTable, ScanSettings, ScanTable
from grainmotion.io.hdf5 import DARK, FLAT
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.stacks import Stack, find_stack
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan


@checked_arguments
def read_scan(
    radiographs: str | Path | Sequence[str | Path],
    geometry: Geometry | str | Path,
    settings: ScanSettings | None = None,
    *,
    flats: str | Path | Sequence[str | Path] | None = None,
    darks: str | Path | Sequence[str | Path] | None = None,
    kind: Kind = "counts",
    beam: Beam = "cone",
) -> Scan:
    """Read a scan from files, as a table of the experiment file would.

    Parameters
    ----------
    radiographs : path, glob, ``"file.h5::/path"``, or a list of those
        TIFF, .npy, HDF5 or one file of a scanner, which brings flats and darks unless they are given.
    geometry : Geometry or path
        One view a radiograph, mm; a path names its CSV, or the file of a scanner.
    settings : ScanSettings, optional
        The other keys of a scan's table: radiographs to use, air, white level, saturation, stage motors, fixes.
    flats, darks : like ``radiographs``, optional
        Images of the open beam and of no beam; averaged.  Only counts need them.
    kind : {"counts", "transmission", "line-integrals"}
        What the pixels of the radiographs are.
    beam : {"cone", "parallel"}
        Beam of a geometry read from CSV.

    Returns
    -------
    Scan
        Line integrals −ln((I − dark)/(flat − dark)), dimensionless, with a mask where pixels are not valid.

    Warns
    -----
    InputWarning
        If radiographs, flats, darks or pixels look wrong, with the likely cause; if a scanner's file leaves something
        doubtful.

    Raises
    ------
    InputError
        If a file is missing or damaged, shapes or numbers of views do not agree, counts come without flats, or
        pixels have values that cannot be; it names the file.

    Examples
    --------
    >>> np.save("state.npy", state.line_integrals)
    >>> scan = gm.read_scan("state.npy", state.geometry, kind="line-integrals")
    >>> len(scan)
    4
    >>> two = gm.read_scan("state.npy", state.geometry, gm.ScanSettings(views=[0, 2]), kind="line-integrals")
    >>> len(two)
    2
    """
    given = geometry if isinstance(geometry, Geometry) else None
    try:
        table = ReferenceTable(
            radiographs=_names(radiographs),
            flats=_names(flats),
            darks=_names(darks),
            kind=kind,
            beam=beam,
            geometry=None if given is not None else str(geometry),
            **({} if settings is None else {key.name: getattr(settings, key.name) for key in fields(settings)}),
        )
    except ValidationError as error:
        raise input_error(error, ReferenceTable, {}) from error
    found = find_scan("scan", table, table, Path(), given)
    scan, _, findings = found.read_checked()
    for finding in (*found.findings, *findings):
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
    sources = ScanSources.of(key, table, reference, folder)
    radiographs = _radiographs(sources)
    kind = sources.kind
    (count, rows, columns), _ = radiographs.info()
    views = _chosen_views(key, table.views, count)
    nxtomo, recorded, circle = radiographs.nxtomo, list[Finding](), None
    if geometry is None:
        geometry, circle = find_views(sources, radiographs)
        recorded += [
            *overridden(key, sources.told, sources.origin, circle, geometry),
            *(circle.findings if circle else ()),
        ]
        if nxtomo is not None:
            origin = None if reference.radiographs is None else _of_reference(sources, radiographs).nxtomo
            motors = reference.motors if table.motors is None else table.motors
            shifts = stage_shifts(key, nxtomo, origin, motors)
            geometry, found = recorded_geometry(key, nxtomo, Told(geometry, circle, views), shifts)
            recorded += found
    geometry = hypotheses.corrected(geometry, table.fixes)
    angles = told_angles_deg(geometry, None if table.fixes or circle is None else circle.angles_deg)
    if len(geometry) == count and views is not None:
        geometry = geometry[views]
    used = count if views is None else len(views)
    if len(geometry) != used:
        raise count_mismatch(key, table, radiographs, angles, used)
    flats, darks = (_find_beam_images(frames, sources, radiographs) for frames in (FLAT, DARK))
    white_level = None
    if kind != "counts":
        flats = darks = None
    elif flats is None:
        white_level = sources.white_level
        if white_level is None:
            raise _without_flats(key, radiographs, count)
    for name, stack in (("flats", flats), ("darks", darks)):
        if stack is not None and stack.info()[0][1:] != (rows, columns):
            fact = f"images of {stack.info()[0][1:]} pixels, but the radiographs have {(rows, columns)}"
            raise InputError(f"{stack.spec} ({key}.{name})", fact, f"give {name} of the same camera settings")
    monitor = recorded_levels(sources.own) if table.flats is None else None  # told over the file's own flats
    if nxtomo is not None and flats is not None:
        of_file = beam_monitor(key, nxtomo, flats.nxtomo)
        monitor, recorded = of_file.monitor, [*recorded, *of_file.findings]
    told, stacks = sources.told, {"radiographs": radiographs, "flats": flats, "darks": darks}
    return ScanInput(
        key=key,
        radiographs=radiographs,
        flats=flats,
        darks=darks,
        kind=kind,
        geometry=geometry,
        views=views,
        air=table.air or reference.air,
        white_level=white_level,
        saturation=table.saturation or reference.saturation,
        monitor=monitor if monitor is None or views is None else monitor[views],
        findings=(
            *_of_file_in_use(told, table),
            *recorded,
            *file_findings(key, table, stacks, angles),
            *axis_findings(f"{key}.geometry", geometry),
        ),
        circle=None if circle is None else circle.table,
        facts=() if told is None else (("Format", told.format), *told.facts),
    )


def _of_file_in_use(told: ScannerFile | None, table: ScanTable) -> tuple[Finding, ...]:
    """Findings about a scanner's file, but those about its angles where the experiment file has others."""
    findings = () if told is None else told.findings
    keys = table.geometry.model_fields_set if isinstance(table.geometry, Circular) else set()
    given = any(getattr(table.geometry, key) is not None for key in keys & set(ANGLE_KEYS))
    return tuple(f for f in findings if not (given and f.check == "angle-table"))


def _radiographs(sources: ScanSources) -> Stack:
    """The radiographs that the table names, or those of the scanner's file that it names."""
    key, own = f"{sources.key}.radiographs", sources.own
    if own is None:
        radiographs = named_stack(key, sources.table.radiographs, sources.folder)
    elif own.radiographs:
        radiographs = named_stack(key, list(own.radiographs), own.path.parent)
    else:
        fact, remedy = (
            "its radiographs are not beside it",
            "copy them there, or name them and give this file as geometry",
        )
        raise InputError(f"{own.path} ({key})", fact, remedy)
    if radiographs is None:
        raise InputError(key, "it is missing", "name the radiographs")
    return radiographs


def _of_reference(sources: ScanSources, radiographs: Stack) -> Stack:
    """The radiographs of the reference, which are those at hand if the scan is it."""
    return radiographs if sources.table is sources.reference else _radiographs(sources.of_reference)


def _without_flats(key: str, radiographs: Stack, count: int) -> InputError:
    """The error of counts without flats, with the kind that the radiographs look like."""
    found = likely_kind(radiographs.read(np.unique([0, count // 2])))
    if found in ("transmission", "line-integrals"):
        fact = f"it is missing, and {radiographs.spec} looks like {found}, not counts"
        return InputError(f"{key}.flats", fact, f'set {key}.kind = "{found}"')
    remedy = (
        "give flats, or set kind to what the images are, or white_level if the scanner has divided them by its flats"
    )
    return InputError(f"{key}.flats", "it is missing", remedy)


def _find_beam_images(frames: int, sources: ScanSources, radiographs: Stack) -> Stack | None:
    """Flats or darks: the scan's own files or those that its scanner's file names, else the reference's."""
    name = {FLAT: "flats", DARK: "darks"}[frames]
    owners = ((sources.key, sources.table, sources.own), ("reference", sources.reference, sources.origin))
    for owner, scan, file in owners:
        key = f"{owner}.{name}"
        stack = named_stack(key, scan.flats if frames == FLAT else scan.darks, sources.folder)
        if stack is not None:
            return stack
        if file is None:
            continue
        specs = file.flats if frames == FLAT else file.darks
        if specs:
            return named_stack(key, list(specs), file.path.parent)
        stack = (
            radiographs if file is sources.own else named_stack(key, list(file.radiographs) or None, file.path.parent)
        )
        nxtomo = None if stack is None else stack.nxtomo
        if stack is not None and nxtomo is not None and nxtomo.count(frames):
            return stack.frames(frames)
    return None


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
