"""Files of a state as they arrive: which are there, whether they still change, and whether the state is complete."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.file_checks import TooFewRadiographsError
from grainmotion.experiment.inputs import check_plausible
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.io.formats import family
from grainmotion.io.locate import locate
from grainmotion.model.volume import Volume

TABLES = (".csv", ".tsv")
"""Suffixes of files that name no images."""


@dataclass(frozen=True)
class Snapshot:
    """The files of a state at one moment.

    Attributes
    ----------
    files : frozenset of (str, int, int)
        Path, size in bytes and time of the last change, ns.
    radiographs : int
        How many of them are of its radiographs.
    missing : str
        What is not there yet; empty if each name of the table has a file.
    """

    files: frozenset[tuple[str, int, int]]
    radiographs: int
    missing: str = ""


def snapshot(table: StateTable, folder: Path) -> Snapshot:
    """The files that the table of a state names, as they are now; no file is opened."""
    files, radiographs, missing = set[tuple[str, int, int]](), 0, ""
    for key, name in _names(table):
        try:
            found = _located(name, folder)
        except (InputError, OSError) as error:
            missing = missing or f"{key}: {error.fact if isinstance(error, InputError) else error}"
            continue
        for path in found:
            try:
                status = path.stat()
            except OSError:  # it was moved or is being replaced
                missing = missing or f"{key}: {path.name} is being replaced"
                continue
            files.add((str(path), status.st_size, status.st_mtime_ns))
            radiographs += key == "radiographs"
            if status.st_size == 0:
                missing = missing or f"{key}: {path.name} is empty"
    return Snapshot(frozenset(files), radiographs, missing)


def complete_state(experiment: Experiment, table: StateTable, grid: Volume) -> ScanInput:
    """The scan of a state whose files are all there, from their headers.

    Raises an `InputError` that says what is not as it must be: too few radiographs for the geometry, one that cannot
    be opened.
    """
    key, watched = f"states.{table.name}", experiment.tables.watch
    try:
        source = find_scan(key, table, experiment.tables.reference, experiment.folder)
    except TooFewRadiographsError as error:
        fact = "{} of {} radiographs are there".format(*error.counts)
        remedy = "wait for the others; if there are no more, give the geometry as many views"
        raise InputError(f"{key}.radiographs", fact, remedy) from error
    if watched is not None and watched.count is not None:
        count = source.radiographs.info()[0][0]
        if count != watched.count:
            remedy = "wait for them, or correct watch.count"
            raise InputError(f"{key}.radiographs", f"{count} of {watched.count} radiographs", remedy)
    check_plausible(key, source.geometry, grid)
    return source


def _names(table: StateTable) -> Iterator[tuple[str, str]]:
    """Key and name of all that a state reads, but for what it has from the reference."""
    for key, names in (("radiographs", table.radiographs), ("flats", table.flats), ("darks", table.darks)):
        for name in names or ():
            yield key, name.partition("::")[0]
    if isinstance(table.geometry, str):
        yield "geometry", table.geometry.partition("::")[0]
    if table.initial not in ("previous", "reference"):
        yield "initial", table.initial


def _located(name: str, folder: Path) -> list[Path]:
    """The files of a name; with a scanner's own file all files beside it, since it names its images."""
    path = folder / name
    found = [path] if path.is_file() else list(locate(name, folder).files)
    if any(family(file) is None and file.suffix.lower() not in TABLES for file in found):
        found += [file for file in path.parent.iterdir() if file.is_file() and file.name[:1] != "."]
    return sorted(set(found))
