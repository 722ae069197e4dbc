"""`grainmotion inspect` and `grainmotion init`: what is in a file or folder, and a first experiment file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grainmotion.cli import console
from grainmotion.cli.findings import exit_at_errors, exit_by, print_findings
from grainmotion.cli.options import Strict
from grainmotion.cli.stages import read
from grainmotion.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from grainmotion.experiment.folder_contents import FolderContents
    from grainmotion.experiment.inspection import FirstViews
    from grainmotion.experiment.scan_summary import ScanSummary
    from grainmotion.model.volume import Volume

EXPERIMENT = "experiment.toml"
MAX_SCANS_SHOWN = 10

Target = Annotated[
    Path, typer.Argument(metavar="FILE_OR_FOLDER", help="experiment file, scanner's file, images, or a folder of those")
]
Picture = Annotated[
    Path | None, typer.Option("--picture", help="PNG to write; inspection.png beside the file by default")
]
Terminal = Annotated[bool, typer.Option("--terminal", help="draw the first radiographs in the terminal as well")]


def inspect(file: Target, *, picture: Picture = None, terminal: Terminal = False, strict: Strict = False) -> None:
    """Say what is in a file or folder, and draw its scan: source, panel, axis, radiographs, up and sense of rotation.

    Example: grainmotion inspect scan.xtekct --terminal

    Example: grainmotion inspect experiment.toml
    """
    from grainmotion.experiment.volume_contents import describe_volume
    from grainmotion.io.volumes.find import is_volume

    if is_volume(file):
        console.print_facts(file.name, describe_volume(file))
    elif file.is_dir():
        _inspect_folder(file, picture, terminal=terminal)
    elif file.suffix.lower() == ".toml":
        _inspect_experiment(file, picture, terminal=terminal, strict=strict)
    else:
        _inspect_file(file, picture, terminal=terminal, strict=strict)


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="folder with the scan and the later radiographs")],
    *,
    force: Annotated[bool, typer.Option("--force", help="replace an experiment file that is there")] = False,
) -> None:
    """Write a commented experiment file from a folder with a full scan and folders of later radiographs.

    Example: grainmotion init measurements
    """
    from grainmotion.experiment.first_draft import draft_experiment
    from grainmotion.experiment.folder_contents import folder_contents
    from grainmotion.experiment.inputs import find_inputs
    from grainmotion.io.files import atomic_write

    path = folder / EXPERIMENT
    if not folder.is_dir():
        raise InputError(str(folder), "it is no folder", "name the folder with the scan and the later radiographs")
    if path.exists() and not force:
        raise InputError(str(path), "it is there already", "edit it, or replace it with --force")
    contents = folder_contents(folder)
    draft = draft_experiment(contents, EXPERIMENT)
    with atomic_write(path) as part:
        part.write_text(draft.text, encoding="utf-8")
    for problem in contents.problems:
        print(f"left out: {problem}")
    print(f"experiment: {path}")
    for item in draft.todo:
        print(f"to fill in: {item}")
    if draft.todo:
        return
    try:
        find_inputs(read(path))
    except InputError as error:
        print(f"to fill in or correct: {error}")
        return
    print(f"next: grainmotion inspect {path}")


def _inspect_experiment(file: Path, picture: Path | None, *, terminal: bool, strict: bool) -> None:
    """The inputs of an experiment file, as a run would check them."""
    from grainmotion.experiment.inputs import find_inputs
    from grainmotion.experiment.inspection import inspect_inputs
    from grainmotion.experiment.last_reference import last_reference
    from grainmotion.workflow.reference_stages import REFERENCE

    inputs = find_inputs(experiment := read(file))
    inspection = inspect_inputs(inputs, experiment.tables)
    console.print_inspection(inspection)
    console.print_reference(last_reference(experiment.output / REFERENCE))
    _draw(file.parent, picture, inspection.first_views, inputs.grid, terminal=terminal)
    exit_at_errors(inspection.findings)
    exit_by({}, inspection.findings, strict=strict)


def _inspect_file(file: Path, picture: Path | None, *, terminal: bool, strict: bool) -> None:
    """One file: a scan by its scanner's file, or whatever else it is."""
    from grainmotion.experiment.file_contents import describe_file
    from grainmotion.experiment.scan_summary import summarise_file
    from grainmotion.io.files import checked_file
    from grainmotion.io.formats import HDF5
    from grainmotion.io.scanners.identify import is_scanner_file, read_scanner_file

    checked_file(file)
    if is_scanner_file(file.name):
        try:
            scan = read_scanner_file(file)
        except InputError:
            if file.suffix.lower() not in HDF5:
                raise
        else:
            summary = summarise_file(file, scan)
            _show_scan(file, summary)
            if summary.first_views is not None and summary.grid is not None:
                _draw(file.parent, picture, (summary.first_views,), summary.grid, terminal=terminal)
            if summary.problem is not None:
                raise summary.problem
            exit_at_errors(summary.findings)
            exit_by({}, summary.findings, strict=strict)
            return
    console.print_facts(file.name, describe_file(file))


def _inspect_folder(folder: Path, picture: Path | None, *, terminal: bool) -> None:
    """A folder: its scans, with the largest of those shown drawn, images, tables and experiment files."""
    from grainmotion.experiment.folder_contents import RESULT_MARK, folder_contents
    from grainmotion.experiment.result_contents import describe_results, results_folder_of
    from grainmotion.experiment.scan_summary import summarise_file

    if results_folder_of(folder / RESULT_MARK) is not None:
        console.print_facts(f"{folder}: results of a run", describe_results(folder))
        return
    contents = folder_contents(folder)
    largest: tuple[str, ScanSummary] | None = None  # radiographs of it alone are kept
    for name, scan in contents.scans[:MAX_SCANS_SHOWN]:
        found = name, summarise_file(folder / name, scan)
        if largest is None or found[1].views > largest[1].views:
            largest, found = found, largest or found
        if found is not largest:
            _show_in_one_line(*found)
    for name, scan in contents.scans[MAX_SCANS_SHOWN:]:
        print(f"scan: {name}, {scan.format}")
    if largest is not None:
        name, summary = largest
        _show_scan(Path(name), summary)
        if summary.problem is not None:
            print(f"not usable: {summary.problem}")
        if summary.first_views is not None and summary.grid is not None:
            _draw(folder, picture, (summary.first_views,), summary.grid, terminal=terminal)
    reference = None if contents.scans else _reference_summary(contents)
    if reference is not None and reference.first_views is not None and reference.grid is not None:
        _show_scan(Path(reference.first_views.name), reference)
        _draw(folder, picture, (reference.first_views,), reference.grid, terminal=terminal)
    _show_rest(contents)


def _reference_summary(contents: FolderContents) -> ScanSummary | None:
    """The largest scan of a folder without scanners' files, if tables beside it tell its views."""
    from grainmotion.experiment.first_draft import draft_experiment
    from grainmotion.experiment.scan_summary import summarise_scan

    try:
        draft = draft_experiment(contents)
        if any(item.startswith("[reference") for item in draft.todo):
            return None
        return summarise_scan("reference", draft.reference, contents.path)
    except InputError:
        return None


def _show_in_one_line(name: str, summary: ScanSummary) -> None:
    """A scan beside a larger one: its format, radiographs and angles, and what is unusual."""
    facts = dict(summary.facts)
    told = [facts.get("Format", ""), facts.get("Radiographs", "").split(" (")[0], facts.get("Angles", "")]
    print(f"scan: {name}: {', '.join(text for text in told if text)}")
    print_findings(summary.findings)
    for line in summary.missing:
        print(f"to be given in the experiment file: {line.strip()}")
    if summary.problem is not None:
        print(f"not usable: {summary.problem}")


def _show_scan(file: Path, summary: ScanSummary) -> None:
    """The facts of a scan, what is unusual, and what the experiment file has to give."""
    console.print_facts(str(file), summary.facts)
    print_findings(summary.findings)
    for line in summary.missing:
        print(f"to be given in the experiment file: {line.strip()}")


def _show_rest(contents: FolderContents) -> None:
    """What a folder holds beside scanners' files."""
    for images in contents.images:
        print(f"images: {images.sentence}")
    for name in contents.tables:
        print(f"table: {name}")
    for name in contents.experiments:
        print(f"experiment file: {name}")
    for problem in contents.problems:
        print(f"not usable: {problem}")
    if contents.others:
        print("other files: " + ", ".join(f"{n} {suffix}" for suffix, n in sorted(contents.others.items())))
    if not (contents.scans or contents.images):
        raise InputError(str(contents.path), "it holds no scan and no images", "name the folder of the measurements")
    if len(contents.experiments) == 1:
        print(f"next: grainmotion inspect {contents.path / contents.experiments[0]}")
    if not contents.experiments:
        print(f"next: grainmotion init {contents.path}")


def _draw(folder: Path, picture: Path | None, scans: Sequence[FirstViews], grid: Volume, *, terminal: bool) -> None:
    """Up and the sense of rotation in words, as a PNG, and in the terminal if wanted."""
    from grainmotion.io.locate import INSPECTION_PICTURE
    from grainmotion.report.inspection_figure import orientation, write_inspection_figure
    from grainmotion.report.terminal_image import terminal_radiograph

    if terminal:
        for first in scans:
            print(f"{first.name}, view {first.views[0]}:\n{terminal_radiograph(first, grid)}")
    for sentence in orientation(scans, grid):
        print(sentence)
    path = picture or folder / INSPECTION_PICTURE
    try:
        write_inspection_figure(path, scans, grid)
        print(f"picture: {path}")
    except InputError as error:
        if picture is not None:
            raise
        print(f"no picture: {error.where} {error.fact}; name another file with --picture")
