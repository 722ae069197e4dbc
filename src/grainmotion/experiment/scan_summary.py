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
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume

SAME_STEP_DEG = 1e-3
"""Steps between angles that differ by less are equal: files hold rounded angles."""
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


def summarise_file(path: Path, file: ScannerFile) -> ScanSummary:
    """The scan of a scanner's file; of the radiographs only some are read.

    A scan that lacks nothing but ``first_row`` is drawn with row 0 at the top, and says so.
    """
    try:
        return summarise_scan(path.stem, ReferenceTable(radiographs=[path.name]), path.parent)
    except InputError as error:
        missing = tuple(str(error).splitlines())
        if error.where.endswith("geometry.first_row"):
            drawn = _drawn_with_row_at_top(path)
            if drawn is not None:
                return replace(drawn, missing=missing)
        facts = (("Format", file.format), *_told(file), *file.facts)
        return ScanSummary(facts, file.findings, missing)


def _drawn_with_row_at_top(path: Path) -> ScanSummary | None:
    """The scan of a file that does not tell where row 0 lies, with it at the top; None if more is missing."""
    circle = Circular(pixel_size=None, first_row="top")
    try:
        summary = summarise_scan(path.stem, ReferenceTable(radiographs=[path.name], geometry=circle), path.parent)
    except InputError:
        return None
    fact, remedy = 'drawn with first_row = "top"', 'if the sample stands on its head in the picture, give "bottom"'
    facts = tuple((label, f"{text}, assumed" if label == "Row 0" else text) for label, text in summary.facts)
    note = Finding(Level.NOTE, "inspect", path.name, fact, remedy=remedy)
    return replace(summary, facts=facts, findings=(*summary.findings, note))


def summarise_scan(name: str, table: ReferenceTable, folder: Path) -> ScanSummary:
    """The scan of a table of the experiment file; of the radiographs only some are read.

    Raises
    ------
    InputError
        If the scan cannot be used.
    """
    source = find_scan("reference", table, table, folder)
    facts = (*source.facts[:1], *_images(source), *_places(source.geometry), *source.facts[1:])
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
    sorted_steps = np.diff(np.unique(np.round(angles_deg % 360, 6)))
    if count > 2 and len(sorted_steps) and np.ptp(sorted_steps) < 2 * SAME_STEP_DEG:
        return f"{span}, interlaced or in several turns, {sorted_steps.mean():.6g} degrees apart when sorted"
    return f"{span}, in irregular steps"


def _same(values: Float, value: float) -> bool:
    return bool(np.abs(values - value).max() < 10 * SAME_STEP_DEG)


def _told(file: ScannerFile) -> list[tuple[str, str]]:
    """The numbers of a file whose scan cannot be used yet."""
    facts = [(name.replace("_", " "), str(value)) for name, value in file.circle.known.items()]
    if file.circle.angles_deg is not None:
        facts.append(("Angles", angle_sentence(file.circle.angles_deg)))
    return facts


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


def _places(geometry: Geometry) -> list[tuple[str, str]]:
    """Beam, distances, pixels, angles and what departs from a perfect set-up."""
    facts: list[tuple[str, str]] = [("Beam", geometry.beam)]
    row_step, column_step = geometry.pixel_sizes.mean(axis=0)
    at_axis = geometry.pixel_at((0, 0, 0))
    if geometry.beam == "cone":
        to_axis = np.linalg.norm(geometry.source[:, :2], axis=1)
        to_panel = np.linalg.norm(geometry.rays, axis=1)
        facts.append(("Source to axis, to panel", f"{to_axis.mean():.6g} mm, {to_panel.mean():.6g} mm"))
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
