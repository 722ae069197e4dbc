"""RX Solutions: ``unireconstruction.xml``, the ``geom.csv`` beside it, and the radiographs in the folder ``Proj``.

The XML has the distances, but neither angles nor the size of the pixels; ``geom.csv``, where the software wrote it,
has everything.  Without it a full turn is assumed in which the stage turns clockwise seen from above, with row 0 at the
top, as a reader for CIL and an example of Pyxu do for scans of one such scanner.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.image_series import ImageSeries, tiff_files, views_shown
from grainmotion.io.scanners.rx_table import ViewTable, read_rx_table
from grainmotion.io.scanners.rx_xml import likely_pixel, rx_facts, rx_number, rx_root
from grainmotion.io.scanners.view_circle import circle_of_views
from grainmotion.model.finding import Finding, Level

MAX_DISTANCE_RATIO = 1.02
"""Distances of the two files that differ by more contradict each other."""
RX_NAME = "RX Solutions"


def read_rx_scan(path: Path) -> ScannerFile:
    """What ``unireconstruction.xml``, or ``geom.csv`` alone, tells about its scan."""
    root = rx_root(path) if path.suffix.lower() == ".xml" else None
    table_path = path.parent / "geom.csv" if root is not None else path
    table = read_rx_table(table_path) if table_path.is_file() else None
    series = _radiographs(path.parent)
    told = None if root is None else rx_number(path, root, "profile", "images")
    if table is None:
        assert root is not None  # a file of another name is the table itself
        assert told is not None
        return _by_distances(path, root, int(told), series)
    if told is not None and told != len(table.images):
        fact = f"it tells {told:.0f} radiographs, but {table.path.name} has {len(table.images)} views"
        raise InputError(str(path), fact, "copy both files of one scan again")
    views, radiographs, findings = _of_table(table, series)
    if root is not None:
        findings += _distance_findings(path, root, table)
    shape = series.shape
    placed = None if shape is None else table.geometry(shape)[views]
    return ScannerFile(
        path,
        RX_NAME,
        (None if placed is None else circle_of_views(placed)) or CircleNumbers(),
        views=placed,
        radiographs=radiographs,
        facts=() if root is None else rx_facts(root),
        findings=findings,
    )


def _by_distances(path: Path, root: ElementTree.Element, planned: int, series: ImageSeries) -> ScannerFile:
    """A scan without ``geom.csv``: distances are told, angles are assumed, the size of the pixels is asked for."""
    views, findings = views_shown(path, series, planned)
    fact = f"its angles are not told: {planned} equal steps of a full turn were assumed, the stage turning clockwise"
    remedy = "put geom.csv beside it, or give angles_deg"
    assumed = Finding(Level.WARNING, "angle-table", path.name, fact, remedy=remedy)
    circle = CircleNumbers(
        beam="cone",
        source_to_axis=rx_number(path, root, "acquisitioninfo/geometry", "sod"),
        source_to_detector=rx_number(path, root, "acquisitioninfo/geometry", "sdd"),
        first_row="top",
        angles_deg=views.astype(float) * (360.0 / planned),
    )
    return ScannerFile(
        path,
        RX_NAME,
        circle,
        radiographs=series.pattern,
        unclear=likely_pixel(root, circle),
        facts=rx_facts(root),
        findings=(*findings, assumed),
    )


def _radiographs(folder: Path) -> ImageSeries:
    """The images in the only folder of projections."""
    found = [p for p in folder.iterdir() if p.is_dir() and p.name.lower().startswith("proj")]
    exact = [p for p in found if p.name.lower() == "proj"] or found
    return tiff_files(exact[0]) if len(exact) == 1 else ImageSeries()


def _of_table(table: ViewTable, series: ImageSeries) -> tuple[list[int], tuple[str, ...], tuple[Finding, ...]]:
    """Which views have a radiograph, their files, and a finding if some are missing."""
    there = {file.name.lower(): file for file in series.files}
    views = [k for k, name in enumerate(table.images) if name.lower() in there]
    if views and len(set(table.images)) == len(table.images):
        files = tuple(there[table.images[k].lower()] for k in views)
        radiographs = series.pattern if files == series.files else tuple(str(file.absolute()) for file in files)
    else:
        shown, _ = views_shown(table.path, series, len(table.images))
        views, radiographs = shown.tolist(), series.pattern
    if not series.files or len(views) == len(table.images):
        return views, radiographs, ()
    fact = f"{len(views)} of {len(table.images)} radiographs are there: the scan was stopped or not completely copied"
    finding = Finding(Level.WARNING, "frames", table.path.name, fact, remedy="those that are there were used")
    return views, radiographs, (finding,)


def _distance_findings(path: Path, root: ElementTree.Element, table: ViewTable) -> tuple[Finding, ...]:
    """Distances of the XML that contradict those of the table."""
    source, center = table.points[:, 0], table.points[:, 1]
    lengths: dict[str, Float] = {
        "sod": np.linalg.norm(source[:, [0, 2]], axis=1),
        "sdd": np.linalg.norm(center - source, axis=1),
    }
    found = []
    for name, values in lengths.items():
        told, value = rx_number(path, root, "acquisitioninfo/geometry", name), float(np.median(values))
        if not 1 / MAX_DISTANCE_RATIO < told / value < MAX_DISTANCE_RATIO:
            fact = f"{name} is {told:.5g} mm, but {table.path.name} makes {value:.5g} mm, which was used"
            remedy = "see that both files are of one scan"
            found.append(Finding(Level.WARNING, "sizes", path.name, fact, remedy=remedy))
    return tuple(found)
