"""`grainmotion inspect` and `grainmotion init`: what is in a file or folder, and a first experiment file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from grainmotion.cli.command import current_call
from grainmotion.cli.description import Description
from grainmotion.cli.no_experiment import EXPERIMENT, check_there, command, experiment_near
from grainmotion.cli.options import Display, Strict
from grainmotion.cli.outcome import Ending, Outcome, ending_of_inspection
from grainmotion.cli.progress import progress
from grainmotion.cli.stages import read
from grainmotion.errors import InputError
from grainmotion.model.finding import Level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from grainmotion.experiment.folder_contents import FolderContents
    from grainmotion.experiment.inspection import FirstViews
    from grainmotion.experiment.scan_summary import ScanSummary
    from grainmotion.model.volume import Volume

MAX_SCANS_SHOWN = 10

Target = Annotated[
    Path, typer.Argument(metavar="FILE_OR_FOLDER", help="experiment file, scanner's file, images, or a folder of those")
]
Picture = Annotated[
    Path | None, typer.Option("--picture", help="PNG to write; inspection.png beside the file by default")
]
Terminal = Annotated[bool, typer.Option("--terminal", help="draw the first radiographs in the terminal as well")]


def inspect(
    file: Target, *, picture: Picture = None, terminal: Terminal = False, strict: Strict = False, display: Display
) -> Outcome:
    """Say what is in a file or folder, and draw its scan: source, panel, axis, radiographs, up and sense of rotation.

    Example: grainmotion inspect scan.xtekct --terminal

    Example: grainmotion inspect experiment.toml
    """
    from grainmotion.experiment.volume_contents import describe_volume
    from grainmotion.io.volumes.find import is_volume

    check_there(file)
    told, drawn = Description(file, display.terminal), Drawing(picture, terminal)
    with progress(display.terminal, current_call().stop):
        if is_volume(file):
            told.facts(file.name, describe_volume(file))
        elif file.is_dir():
            _inspect_folder(file, told, drawn)
        elif file.suffix.lower() == ".toml":
            _inspect_experiment(file, told, drawn)
        else:
            _inspect_file(file, told, drawn)
    found = tuple(told.found)
    ending = Ending() if file.is_dir() else ending_of_inspection(found, strict=strict)
    return Outcome(told.document, lambda _terminal: None, found, ending)


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="folder with the scan and the later radiographs")],
    *,
    force: Annotated[bool, typer.Option("--force", help="replace an experiment file that is there")] = False,
    display: Display,
) -> Outcome:
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
    with progress(display.terminal, current_call().stop):
        contents = folder_contents(folder)
        draft = draft_experiment(contents, EXPERIMENT)
    with atomic_write(path) as part:
        part.write_text(draft.text, encoding="utf-8")
    told = Description(path, display.terminal)
    for problem in contents.problems:
        told.line("left out", problem)
    told.line("experiment", path)
    for item in draft.todo:
        told.line("to fill in", item)
    if not draft.todo:
        try:
            find_inputs(read(path))
            told.line("next", command("inspect", path))
        except InputError as error:
            told.line("to fill in or correct", error)
    return Outcome(told.document, lambda _terminal: None)


@dataclass(frozen=True)
class Drawing:
    """Where a picture goes, and whether radiographs are drawn in the terminal too."""

    picture: Path | None
    terminal: bool


def _inspect_experiment(file: Path, told: Description, drawn: Drawing) -> None:
    """The inputs of an experiment file, as a run would check them."""
    from grainmotion.experiment.inputs import find_inputs
    from grainmotion.experiment.inspection import inspect_inputs
    from grainmotion.experiment.last_reference import last_reference
    from grainmotion.workflow.reference_stages import REFERENCE

    inputs = find_inputs(experiment := read(file))
    inspection = inspect_inputs(inputs, experiment.tables)
    told.inspection(inspection)
    sentences = last_reference(experiment.output / REFERENCE)
    if sentences:
        told.drawing("reference of the last run, with shares of its attenuation:")
    for sentence in sentences:
        told.sentence(f"  {sentence}", "reference of the last run")
    _draw(file.parent, told, drawn, inspection.first_views, inputs.grid)
    if inputs.states and not any(f.level is Level.ERROR for f in inspection.findings):
        told.line("next", f"{command('run', file)} --dry-run")


def _inspect_file(file: Path, told: Description, drawn: Drawing) -> None:
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
            _show_scan(file, summary, told)
            if summary.first_views is not None and summary.grid is not None:
                _draw(file.parent, told, drawn, (summary.first_views,), summary.grid)
            if summary.problem is not None:
                raise summary.problem
            _next_of_file(file, told)
            return
    told.facts(file.name, describe_file(file))
    _next_of_file(file, told)


def _next_of_file(file: Path, told: Description) -> None:
    """The command that follows the look at a file of data."""
    from grainmotion.io.formats import family
    from grainmotion.io.scanners.identify import is_scanner_file

    if not (is_scanner_file(file.name) or family(file) is not None):
        return
    near = experiment_near(file)
    told.line("next", command("init", file.parent) if near is None else command("inspect", near))


def _inspect_folder(folder: Path, told: Description, drawn: Drawing) -> None:
    """A folder: its scans, with the largest of those shown drawn, images, tables and experiment files."""
    from grainmotion.experiment.folder_contents import RESULT_MARK, folder_contents
    from grainmotion.experiment.result_contents import describe_results, results_folder_of
    from grainmotion.experiment.scan_summary import summarise_file

    if results_folder_of(folder / RESULT_MARK) is not None:
        told.facts(f"{folder}: results of a run", describe_results(folder))
        return
    contents = folder_contents(folder)
    largest: tuple[str, ScanSummary] | None = None  # radiographs of it alone are kept
    for name, scan in contents.scans[:MAX_SCANS_SHOWN]:
        found = name, summarise_file(folder / name, scan)
        if largest is None or found[1].views > largest[1].views:
            largest, found = found, largest or found
        if found is not largest:
            _show_in_one_line(*found, told)
    for name, scan in contents.scans[MAX_SCANS_SHOWN:]:
        told.line("scan", f"{name}, {scan.format}")
    if largest is not None:
        name, summary = largest
        _show_scan(Path(name), summary, told)
        if summary.problem is not None:
            told.line("not usable", summary.problem)
        if summary.first_views is not None and summary.grid is not None:
            _draw(folder, told, drawn, (summary.first_views,), summary.grid)
    reference = None if contents.scans else _reference_summary(contents)
    if reference is not None and reference.first_views is not None and reference.grid is not None:
        _show_scan(Path(reference.first_views.name), reference, told)
        _draw(folder, told, drawn, (reference.first_views,), reference.grid)
    _show_rest(contents, told)


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


def _show_in_one_line(name: str, summary: ScanSummary, told: Description) -> None:
    """A scan beside a larger one: its format, radiographs and angles, and what is unusual."""
    facts = dict(summary.facts)
    parts = [facts.get("Format", ""), facts.get("Radiographs", "").split(" (")[0], facts.get("Angles", "")]
    told.line("scan", f"{name}: {', '.join(text for text in parts if text)}")
    _show_lacking(summary, told)
    if summary.problem is not None:
        told.line("not usable", summary.problem)


def _show_scan(file: Path, summary: ScanSummary, told: Description) -> None:
    """The facts of a scan, what is unusual, and what the experiment file has to give."""
    told.facts(str(file), summary.facts)
    _show_lacking(summary, told)


def _show_lacking(summary: ScanSummary, told: Description) -> None:
    """What is unusual about a scan, and what the experiment file has to give."""
    told.findings(summary.findings)
    for line in summary.missing:
        told.line("to be given in the experiment file", line.strip())


def _show_rest(contents: FolderContents, told: Description) -> None:
    """What a folder holds beside scanners' files."""
    from grainmotion.workflow.outputs import REPORT

    for images in contents.images:
        told.line("images", images.sentence)
    for name in contents.tables:
        told.line("table", name)
    for name in contents.experiments:
        told.line("experiment file", name)
    for problem in contents.problems:
        told.line("not usable", problem)
    if contents.others:
        told.line("other files", ", ".join(f"{n} {suffix}" for suffix, n in sorted(contents.others.items())))
    for name in contents.results:
        report = contents.path / name / REPORT
        told.line("results", report if report.is_file() else report.parent)
    if not (contents.scans or contents.images or contents.experiments):
        raise InputError(str(contents.path), "it holds no scan and no images", "name the folder of the measurements")
    for name in [EXPERIMENT] if EXPERIMENT in contents.experiments else contents.experiments:
        told.line("next", command("inspect", contents.path / name))
    if not contents.experiments:
        told.line("next", command("init", contents.path))


def _draw(folder: Path, told: Description, drawn: Drawing, scans: Sequence[FirstViews], grid: Volume) -> None:
    """Up and the sense of rotation in words, as a PNG, and in the terminal if wanted."""
    from grainmotion.io.locate import INSPECTION_PICTURE
    from grainmotion.report.inspection_figure import orientation, write_inspection_figure
    from grainmotion.report.terminal_image import terminal_radiograph

    if drawn.terminal:
        for first in scans:
            told.drawing(f"{first.name}, view {first.views[0]}:\n{terminal_radiograph(first, grid)}")
    for sentence in orientation(scans, grid):
        told.sentence(sentence)
    path = drawn.picture or folder / INSPECTION_PICTURE
    try:
        write_inspection_figure(path, scans, grid)
        told.line("picture", path)
    except InputError as error:
        if drawn.picture is not None:
            raise
        told.line("no picture", f"{error.where} {error.fact}; name another file with --picture")
