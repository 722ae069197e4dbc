"""What one file is: a scan, images, labels, motions, a table, results; for files that are no experiment file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grainmotion.diagnosis.grey_values import likely_kind
from grainmotion.errors import InputError
from grainmotion.experiment.result_contents import describe_result
from grainmotion.experiment.scan_summary import angle_sentence
from grainmotion.experiment.volume_contents import describe_volume, voxel_lines
from grainmotion.io.angles import read_angles
from grainmotion.io.files import checked_file
from grainmotion.io.formats import HDF5, family, unreadable
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.hdf5 import opened
from grainmotion.io.motions_csv import read_motions
from grainmotion.io.scanners.view_tables import view_file
from grainmotion.io.spam import DDIC_COLUMNS
from grainmotion.io.stacks import find_stack
from grainmotion.io.text import read_text
from grainmotion.model.geometry import Geometry

MAX_IMAGES_READ = 5
"""Images from which the kind of values is judged."""
MAX_DATASETS = 40
MIN_LABELS, MAX_LABEL_SHARE = 2, 0.2
"""Whole numbers are labels if there are so many, each in whole patches: fewer values than this share of the pixels."""


def describe_file(path: Path) -> tuple[tuple[str, str], ...]:
    """Label and text of each line about a file.

    Raises
    ------
    InputError
        If the file is missing, damaged or of an unknown format.
    """
    path = checked_file(path)
    result = describe_result(path)
    if (table := view_file(path)) is not None:
        return (*result, *_views(table))
    if family(path) == HDF5:
        return (*result, *(_hdf5(path) if not result else ()))
    if family(path) is not None:
        return (*result, *_images_or_volume(path))
    for describe in (_motions, _spam, _csv_views, _angles):
        try:
            return (*result, *describe(path))
        except InputError:
            continue
    if result:
        return result
    raise unreadable(path)


def _hdf5(path: Path) -> tuple[tuple[str, str], ...]:
    """The datasets of an HDF5 file that is no scan."""
    lines: list[tuple[str, str]] = []
    with opened(path) as file:

        def note(name: str, item: object) -> None:
            if hasattr(item, "dtype") and hasattr(item, "shape"):
                lines.append((f"{path.name}::/{name}", f"{' x '.join(map(str, item.shape)) or 'scalar'} {item.dtype}"))

        file.visititems(note)
    more = [("", f"... and {len(lines) - MAX_DATASETS} more datasets")] if len(lines) > MAX_DATASETS else []
    return (("HDF5 file", f"{len(lines)} datasets"), *lines[:MAX_DATASETS], *more)


def _images_or_volume(path: Path) -> tuple[tuple[str, str], ...]:
    """Images, or what is a volume or labels alone: an array with a channel, numbers of a colour map."""
    try:
        return _images(path)
    except InputError as error:
        try:
            return describe_volume(path)
        except InputError:
            raise error from None


def _images(path: Path) -> tuple[tuple[str, str], ...]:
    """Size, type and values of images, a volume or labels."""
    stack = find_stack(path)
    (count, rows, columns), dtype = stack.info()
    some = stack.read(np.unique(np.linspace(0, count - 1, MAX_IMAGES_READ).astype(int)))
    values = np.unique(some[:, ::3, ::3])
    kind = likely_kind(some) if min(some.shape[1:]) > 2 else ""
    if dtype.kind in "iu" and MIN_LABELS < len(values) < MAX_LABEL_SHARE * some.size / 9 and _in_patches(some):
        kind = "labels"
    return (
        ("Images", f"{count} x {rows} x {columns} (images, rows, columns) {dtype}"),
        *voxel_lines(path),
        ("Values", f"{_range(some)} in {len(some)} of the images"),
        ("Looks like", kind or "unknown: neither counts, transmission, line integrals nor labels"),
    )


def _range(images: np.ndarray) -> str:
    """The smallest and the largest value, and how many are missing."""
    missing = float(np.isnan(images).mean()) if images.dtype.kind == "f" else 0.0
    if missing == 1:
        return "NaN"
    return f"{np.nanmin(images):g} to {np.nanmax(images):g}" + (f", {missing:.0%} NaN," if missing else "")


def _in_patches(images: np.ndarray) -> bool:
    """Whether most neighbouring pixels are equal, as in labels."""
    return bool(np.mean(images[:, :, 1:] == images[:, :, :-1]) > 1 - MAX_LABEL_SHARE)


def _motions(path: Path) -> tuple[tuple[str, str], ...]:
    motions = read_motions(path)
    names, counts = np.unique(motions.statuses, return_counts=True)
    statuses = ", ".join(f"{n} {name}" for name, n in zip(names, counts))
    return ("Motions", f"{len(motions)} grains: {statuses}"), ("Use", 'key initial of a state, or "motions" in Python')


def _spam(path: Path) -> tuple[tuple[str, str], ...]:
    import pandas as pd  # takes half a second and 60 MB

    header = read_text(path).split("\n", 1)[0].split("\t")
    if len(set(header) & set(DDIC_COLUMNS)) < len(DDIC_COLUMNS) // 2:
        raise InputError(str(path), "no table of spam", "")
    rows = len(pd.read_csv(path, sep="\t"))
    return ("Motions of spam", f"{rows} labels, in voxels"), ("Use", "key initial of a state")


def _csv_views(path: Path) -> tuple[tuple[str, str], ...]:
    return _views(read_geometry(path, (1, 1)))


def _views(geometry: Geometry) -> tuple[tuple[str, str], ...]:
    return (
        ("Views", f"{len(geometry)} positions of source and panel"),
        ("Angles", angle_sentence(geometry.azimuths_deg)),
        ("Use", "key geometry of a scan"),
    )


def _angles(path: Path) -> tuple[tuple[str, str], ...]:
    return (("Angles", angle_sentence(read_angles(path))), ("Use", "key angles_deg of a geometry"))
