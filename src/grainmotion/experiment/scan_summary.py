"""One scan in a few lines, from headers and some radiographs: what a scanner's file gives before any experiment."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.hypotheses import seen_from_behind, stage_angles_deg
from grainmotion.errors import InputError
from grainmotion.experiment.inspection import FirstViews, drawn_views
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import Circular, ReferenceTable
from grainmotion.io.scanners.description import ScannerFile
from grainmotion.io.stacks import find_stack
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume

SAME_STEP_DEG = 1e-3
"""Steps between angles that differ by less are equal: files hold rounded angles."""
MIN_REGULAR_SHARE = 0.8
"""Views at equal steps, of all, after which the others are returns to earlier angles."""
MAX_RETURNS_SHOWN = 4
MAX_READOUT_SHARE = 0.2
"""Steps of a scan that are read from an encoder differ by less, of a step."""
BRIGHTEST_PIXELS_PERCENTILE = 99.0
"""Brightest pixels of a radiograph, which see air."""
GOLDEN_STEP_DEG = 180 * (np.sqrt(5) - 1)
"""Step of a golden-ratio scan, 222.49 degrees; modulo a half turn 42.49 or its complement."""


@dataclass(frozen=True, eq=False)
class ScanSummary:
    """What is known of a scan.

    Attributes
    ----------
    facts : tuple of (str, str)
        Label and text, one line each.
    findings : tuple of Finding
        What is unusual in the files.
    missing : tuple of str
        What the experiment file has to give before the scan can be used; empty if nothing.
    problem : InputError, optional
        Why the files cannot be used.
    first_views : FirstViews, optional
        Some radiographs as line integrals, if they can be read.
    grid : Volume, optional
        The field of view.
    views : int
        Number of radiographs; 0 if the scan cannot be used yet.
    """

    facts: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...] = ()
    missing: tuple[str, ...] = ()
    first_views: FirstViews | None = None
    grid: Volume | None = None
    views: int = 0
    problem: InputError | None = None


def summarise_file(path: Path, file: ScannerFile) -> ScanSummary:
    """The scan of a scanner's file; of the radiographs only some are read.

    A scan that lacks nothing but ``first_row`` or the open beam is drawn with row 0 at the top and the brightest
    pixels for air, and says so.
    """
    table, missing, assumed = ReferenceTable(radiographs=[path.name]), list[str](), list[Finding]()
    while True:
        try:
            summary = summarise_scan(path.stem, table, path.parent)
        except InputError as error:
            if not error.where.startswith("reference.") or "it is missing" not in str(error):  # the fault of a file
                facts = (("Format", file.format), *_told(file), *file.facts)
                return ScanSummary(facts, file.findings, tuple(missing), problem=error)
            missing += str(error).splitlines()
            complete = _with_assumption(error, table, path, file)
            if complete is None:
                facts = (("Format", file.format), *_told(file), *file.facts)
                return ScanSummary(facts, file.findings, tuple(missing))
            table, note = complete
            assumed.append(note)
        else:
            row = "assumed" if table.geometry is not None else ""
            facts = tuple(
                (label, f"{text}, {row}" if row and label == "Row 0" else text) for label, text in summary.facts
            )
            return replace(summary, facts=facts, findings=(*summary.findings, *assumed), missing=tuple(missing))


def _with_assumption(
    error: InputError, table: ReferenceTable, path: Path, file: ScannerFile
) -> tuple[ReferenceTable, Finding] | None:
    """The table with what is missing assumed, for a picture, and a note that says so; None if it cannot be assumed."""
    if error.where == "reference.geometry.first_row" and table.geometry is None:
        fact, remedy = 'drawn with first_row = "top"', 'if the sample stands on its head in the picture, give "bottom"'
        changed = table.model_copy(update={"geometry": Circular(pixel_size=None, first_row="top")})
    elif error.where == "reference.flats" and table.white_level is None and file.radiographs:
        first = find_stack(list(file.radiographs), file.path.parent).read(np.array([0]))
        level = float(np.percentile(first, BRIGHTEST_PIXELS_PERCENTILE))
        if not level > 0:
            return None
        fact = f"drawn with an open beam of {level:g} counts, that of the brightest pixels of the first radiograph"
        remedy = "give flats or white_level"
        changed = table.model_copy(update={"white_level": level})
    else:
        return None
    return changed, Finding(Level.NOTE, "inspect", path.name, fact, remedy=remedy)


def summarise_scan(name: str, table: ReferenceTable, folder: Path) -> ScanSummary:
    """The scan of a table of the experiment file; of the radiographs only some are read.

    Raises
    ------
    InputError
        If the scan cannot be used.
    """
    source = find_scan("reference", table, table, folder)
    facts = (*source.facts[:1], *_images(source), *_places(source.geometry, source.circle), *source.facts[1:])
    views = drawn_views(source.geometry)
    scan, _, found = source.select(views).read_checked()
    first = FirstViews(name, scan, tuple(views.tolist()))
    findings = (*source.findings, *found)
    return ScanSummary(facts, findings, (), first, _field_of_view(source.geometry), len(source.geometry))


def angle_sentence(angles_deg: Float) -> str:
    """Angles in words: "361 from 0 to 360 degrees in steps of 1", "interlaced", "golden-ratio steps"."""
    count = len(angles_deg)
    if count == 1:
        return f"1 at {angles_deg[0]:g} degrees"
    span = f"{count} from {angles_deg.min():g} to {angles_deg.max():g} degrees"
    steps = np.diff(angles_deg)
    if np.ptp(steps) < SAME_STEP_DEG:
        step = float(np.mean(steps))
        if abs(step) < 180:
            return f"{count} from {angles_deg[0]:g} to {angles_deg[-1]:g} degrees in steps of {step:.6g}"
    if _same(np.mod(steps, 180), GOLDEN_STEP_DEG % 180) or _same(np.mod(-steps, 180), GOLDEN_STEP_DEG % 180):
        return f"{span}, in steps of the golden ratio"
    usual = float(np.median(steps))
    regular = int(np.argmax(np.append(np.abs(steps - usual) >= SAME_STEP_DEG, True))) + 1  # up to the first other step
    if MIN_REGULAR_SHARE * count < regular < count:
        last = ", ".join(f"{a:g}" for a in angles_deg[regular:][:MAX_RETURNS_SHOWN])
        more = ", ..." if count - regular > MAX_RETURNS_SHOWN else ""
        return f"{angle_sentence(angles_deg[:regular])}, then {count - regular} more: {last}{more}"
    mean = float(np.mean(steps))
    off = float(np.abs(steps - mean).max())
    if off < MAX_READOUT_SHARE * abs(mean):
        return f"{count} from {angles_deg[0]:g} to {angles_deg[-1]:g} degrees in steps of {mean:.4g}, each to {off:.1g}"
    sorted_steps = np.diff(np.unique(np.round(angles_deg % 360, 6)))
    if count > 2 and len(sorted_steps) and np.ptp(sorted_steps) < 2 * SAME_STEP_DEG:
        return f"{span}, interlaced or in several turns, {sorted_steps.mean():.6g} degrees apart when sorted"
    return f"{span}, in irregular steps"


def _same(values: Float, value: float) -> bool:
    return bool(np.abs(values - value).max() < 10 * SAME_STEP_DEG)


def _told(file: ScannerFile) -> list[tuple[str, str]]:
    """The numbers of a file whose scan cannot be used yet."""
    facts = [(name.replace("_", " "), _shown(value)) for name, value in file.circle.known.items()]
    if file.views is not None:
        return _places(file.views)
    if file.circle.angles_deg is not None:
        facts.append(("Angles", angle_sentence(file.circle.angles_deg)))
    return facts


def _shown(value: object) -> str:
    """A number or numbers without the sign of zero, or a word."""
    if isinstance(value, tuple):
        return ", ".join(map(_shown, value))
    return f"{value + 0.0:.6g}" if isinstance(value, float) else str(value)


def _images(source: ScanInput) -> list[tuple[str, str]]:
    """Numbers and types of the images."""
    (count, rows, columns), dtype = source.radiographs.info()
    facts = [("Radiographs", f"{count} of {rows} x {columns} pixels (rows, columns), {dtype}, {source.kind}")]
    for name, stack in (("Flats", source.flats), ("Darks", source.darks)):
        if stack is not None:
            facts.append((name, str(stack.info()[0][0])))
        elif source.kind == "counts" and name == "Flats" and source.white_level:
            facts.append((name, f"none: divided by the scanner, open beam {source.white_level:g}"))
        elif source.kind == "counts":
            facts.append((name, "none"))
    return facts


def _places(geometry: Geometry, circle: Circular | None = None) -> list[tuple[str, str]]:
    """Beam, distances (those of a circle as told), pixels, angles and what departs from a perfect set-up."""
    facts: list[tuple[str, str]] = [("Beam", geometry.beam)]
    row_step, column_step = geometry.pixel_sizes.mean(axis=0)
    at_axis = geometry.pixel_at((0, 0, 0))
    if geometry.beam == "cone":
        normals = geometry.normals / np.linalg.norm(geometry.normals, axis=1, keepdims=True)
        to_axis, to_panel = (np.abs((a * normals).sum(axis=1)) for a in (geometry.source, geometry.rays))
        told = (None, None) if circle is None else (circle.source_to_axis, circle.source_to_detector)
        near, far = (t or d.mean() for t, d in zip(told, (to_axis, to_panel), strict=True))
        facts.append(("Source to axis, to panel", f"{near:.6g} mm, {far:.6g} mm"))
    steps = f"{column_step:.6g} mm" if np.isclose(row_step, column_step) else f"{column_step:.6g} x {row_step:.6g} mm"
    facts.append(("Pixel, at the axis", f"{steps}, {at_axis:.6g} mm (magnification {column_step / at_axis:.4g})"))
    behind = seen_from_behind(geometry)
    facts.append(("Angles", angle_sentence(stage_angles_deg(geometry) + 180 * behind)))
    axis = geometry.project_points([[0.0, 0.0, 0.0]])[:, 0]
    middle = (np.array(geometry.shape) - 1) / 2
    row, column = np.nanmean(axis, axis=0) - middle
    facts.append(("Axis on the panel", f"{column:+.3f} columns and {row:+.3f} rows from its centre"))
    top = "the lowest" if geometry.v[:, 2].mean() > 0 else "the highest"
    facts.append(("Row 0", f"{top} row"))
    if behind:
        facts.append(("Column 0", "at the right, as the source sees the panel"))
    return facts


def _field_of_view(geometry: Geometry) -> Volume:
    """Zeros on the grid that a run takes without a table ``[volume]``."""
    rows, columns = geometry.shape
    return Volume.zeros((rows, columns, columns), geometry.pixel_at((0, 0, 0)))
