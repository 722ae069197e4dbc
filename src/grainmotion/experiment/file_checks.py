"""What names and numbers of a scan's files say about it, before a pixel is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.angle_table import angle_findings
from grainmotion.diagnosis.file_series import (
    FILE_SERIES,
    count_hint,
    listed_order,
    series_findings,
    stranger_findings,
)
from grainmotion.diagnosis.hypotheses import stage_angles_deg
from grainmotion.errors import InputError
from grainmotion.experiment.scan_tables import Circular, ScanTable
from grainmotion.io.stacks import Stack
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry


def told_angles_deg(geometry: Geometry, angles_deg: Float | None) -> Float:
    """The angles of the views: as they are told, else those of the stage that a CSV of views implies."""
    return stage_angles_deg(geometry) if angles_deg is None else angles_deg


def file_findings(
    key: str, table: ScanTable, stacks: dict[str, Stack | None], angles_deg: Float
) -> tuple[Finding, ...]:
    """Findings about the files and the told angles of one scan.

    ``stacks`` holds its radiographs, flats and darks by the names of their keys.  ``angles_deg`` are those of all
    radiographs or of the chosen ones, in degrees.
    """
    names = {name: _names(stack) for name, stack in stacks.items()}
    found: list[Finding] = []
    for name, stack in stacks.items():
        given = {"radiographs": table.radiographs, "flats": table.flats, "darks": table.darks}[name]
        if stack is None or given is None:
            continue
        where = f"{key}.{name}"
        found += [Finding(Level.NOTE, FILE_SERIES, where, note) for note in stack.notes]
        if name != "radiographs":
            found += stranger_findings(where, names[name]) if stack.series else ()
        elif stack.series:
            told = angles_deg if len(angles_deg) == len(names[name]) else None
            found += series_findings(where, names[name], told, names["flats"] + names["darks"])
        else:
            found += listed_order(where, names[name])
    place = f"{key}.geometry.angles_deg" if isinstance(table.geometry, Circular) else f"{key}.geometry"
    return (*found, *_depths(key, stacks), *angle_findings(place, angles_deg))


def _depths(key: str, stacks: dict[str, Stack | None]) -> list[Finding]:
    """Radiographs of 8 bits beside flats of more, or the other way: one of them was exported on another scale."""
    dtypes = {name: _first(stack).info()[1] for name, stack in stacks.items() if stack is not None}
    whole = {name: dtype for name, dtype in dtypes.items() if dtype.kind in "ui"}
    if not {"radiographs", "flats"} <= set(whole) or (whole["radiographs"].itemsize == 1) == (
        whole["flats"].itemsize == 1
    ):
        return []
    fact = f"radiographs are {whole['radiographs']} and flats {whole['flats']}: one of them is probably scaled"
    remedy = "export radiographs, flats and darks alike, without scaling grey values"
    return [Finding(Level.WARNING, FILE_SERIES, f"{key}.radiographs", fact, remedy=remedy)]


def _first(stack: Stack) -> Stack:
    """The first file of a stack; a stack of one file is it, and knows its header already."""
    return stack if len(stack.parts) == 1 else replace(stack, parts=stack.parts[:1])


def axis_findings(where: str, geometry: Geometry) -> tuple[Finding, ...]:
    """A finding if the panel does not see the rotation axis, from which all places of the sample are counted."""
    columns = geometry.project_points([[0.0, 0.0, 0.0]])[:, 0, 1]
    column, width = float(np.median(columns)), geometry.shape[1]
    if not np.isfinite(column) or -0.5 <= column <= width - 0.5:
        return ()
    beside = -column if column < 0 else column - (width - 1)
    fact = f"the rotation axis is seen {beside:.1f} columns beside the panel of {width} columns"
    remedy = "check axis_offset, detector_offset and the unit of lengths, which is mm"
    return (Finding(Level.WARNING, "sizes", where, fact, remedy=remedy),)


class TooFewRadiographsError(InputError):
    """Fewer radiographs than views: of a scan that goes on, the others are still to come.

    ``counts`` are the radiographs that are there and those that the geometry tells of.
    """

    counts: tuple[int, int] = (0, 0)


def count_mismatch(key: str, table: ScanTable, radiographs: Stack, angles_deg: Float, used: int) -> InputError:
    """The error about another number of views than of radiographs, of which ``used`` are chosen, with its cause."""
    source = f"{table.geometry} ({key}.geometry)" if isinstance(table.geometry, str) else f"{key}.geometry"
    shape, views = radiographs.info()[0], len(angles_deg)
    fact = f"{views} views, but {radiographs.spec} ({key}.radiographs) holds {shape[0]} radiographs"
    if used != shape[0]:
        fact += f", of which {used} are chosen"
    else:
        hint = count_hint(_names(radiographs), views, shape, angles_deg)
        fact += f" ({hint})" if hint else ""
    remedy = "give one view a radiograph, in the same order"
    if shape[0] >= views:
        return InputError(source, fact, remedy)
    error = TooFewRadiographsError(source, fact, remedy)
    error.counts = shape[0], views
    return error


def _names(stack: Stack | None) -> list[str]:
    """Names of the files of a stack, from the folder on that they share."""
    if stack is None:
        return []
    files: tuple[Path, ...] = stack.files
    folders = {file.parent for file in files}
    return [file.name if len(folders) == 1 else f"{file.parent.name}/{file.name}" for file in files]
