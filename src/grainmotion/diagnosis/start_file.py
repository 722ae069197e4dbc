"""Motions from a file from which a state starts, held against the grains: units, axes, numbering and size."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from scipy.spatial import KDTree

from grainmotion._typing import Float
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume

START_CHECK: Check = "start-file"
MAX_CENTER_ERROR = 0.25
"""Median distance of the file's centres from those of the grains, over the grains' radius.

Centres by volume instead of attenuation differ by up to 0.05, those of another segmentation of the same volume by 0.1;
of another reference by 0.5 and more.
"""
MIN_MATCHED_SHARE = 0.8
"""Share of centres that another numbering must match to be named."""
MAX_START_TRANSLATION = 1.0
"""Translation of a grain over the extent of the sample, from which it cannot be."""
MAX_ROWS_NAMED = 5
"""Grains that one finding lists."""


def check_start(start: Motions, grains: GrainSet, grid: Volume, where: str = "start") -> tuple[Finding, ...]:
    """Findings about motions from which a state is to start.

    Parameters
    ----------
    start : Motions
        As read.
    grains : GrainSet
        The grains to be tracked.
    grid : Volume
        Grid of the reference volume.
    where : str
        File and key, for the findings.

    Returns
    -------
    tuple of Finding
        Empty if the motions fit the grains.
    """
    rows = {int(label): k for k, label in enumerate(start.labels)}
    known = [k for k, grain in enumerate(grains.grains) if grain.label in rows]
    if not known:
        return ()  # tracking refuses it
    order = [rows[grains.grains[k].label] for k in known]
    volumes = [np.count_nonzero(grains.grains[k].volume.array) for k in known]
    radius = float(np.median(np.cbrt(np.multiply(volumes, 3 / (4 * np.pi))))) * grains.voxel_size
    return (
        *_refused_rows(start, where),
        *_centers(start.centers[order], grains.centers[known], radius, grid, where),
        *_translations(start, grid, where),
    )


def _refused_rows(start: Motions, where: str) -> Iterable[Finding]:
    """Rows whose gradient is no rotation, as `io.spam` read them."""
    bad = [(label, reason) for label, reason in zip(start.labels, start.reasons, strict=True) if "gradient" in reason]
    if not bad:
        return
    fact = f"{len(bad)} of {len(start)} motions are no rigid motions and are not used as given"
    evidence = "; ".join(f"grain {label}: {reason}" for label, reason in bad[:MAX_ROWS_NAMED])
    all_mirrored = len(bad) == len(start) and all("mirrored" in reason for _, reason in bad)
    remedy = "the file's axes are mirrored: correct the signs of F" if all_mirrored else "check these rows"
    yield Finding(Level.WARNING, START_CHECK, where, fact, evidence, remedy)


def _centers(given: Float, centers: Float, radius: float, grid: Volume, where: str) -> Iterable[Finding]:
    """Whether the file's centres are those of the grains, or would be after a usual mistake."""
    finite = np.isfinite(given).all(axis=1)
    given, centers = given[finite], centers[finite]
    if not len(given):
        return
    told = _distance(given, centers) / radius
    if told <= MAX_CENTER_ERROR:
        return
    for mistake, change in _mistakes(given, centers, grid):
        left = _distance(change(given), centers) / radius
        if left <= MAX_CENTER_ERROR:
            fact = f"its centres do not match the grains: {mistake}"
            evidence = f"median distance {told:.2g} grain radii, and {left:.2g} then"
            yield Finding(Level.ERROR, START_CHECK, where, fact, evidence, "give the motions of this reference")
            return
    near, _ = KDTree(centers).query(given)
    if np.mean(near <= MAX_CENTER_ERROR * radius) >= MIN_MATCHED_SHARE:
        fact = "its labels number the grains otherwise: the centres match those of other labels"
        evidence = f"median distance {told:.2g} grain radii by label, {np.median(near) / radius:.2g} to the nearest"
        yield Finding(Level.ERROR, START_CHECK, where, fact, evidence, "give the motions of these labels")
        return
    fact = "its centres do not match the grains: motions of another reference, voxel size or volume"
    evidence = f"median distance {told:.2g} grain radii"
    yield Finding(Level.WARNING, START_CHECK, where, fact, evidence, "give the motions of this reference")


def _mistakes(given: Float, centers: Float, grid: Volume) -> Iterable[tuple[str, Callable[[Float], Float]]]:
    """Usual mistakes, and what undoes each."""
    origin, h = grid.origin, grid.voxel_size
    last = origin + h * (np.array(grid.shape[::-1]) - 1)
    yield "they are in the order z y x of axes", lambda c: c[:, ::-1]
    yield "they are in voxels, not in mm", lambda c: origin + h * c
    yield "they are in voxels, z y x, not in mm", lambda c: origin + h * c[:, ::-1]
    yield "positions are in the order x y z of axes instead of z y x", lambda c: origin + (c - origin)[:, ::-1]
    for axis, name in enumerate("xyz"):
        sign = np.where(np.arange(3) == axis, -1, 1)
        middle = np.where(np.arange(3) == axis, origin + last, 0)
        yield f"they are mirrored along {name}", partial(_scaled, factor=sign, place=middle / 2)
    for place, text in ((origin, "from the corner of the volume"), (np.zeros(3), "from the rotation axis")):
        lengths = ((given - place) ** 2).sum()
        factor = float(((given - place) * (centers - place)).sum() / lengths) if lengths > 0 else 1.0
        name = f"they are {1 / factor:.4g} times as far {text} (another voxel size or unit)" if factor > 0 else ""
        yield name, partial(_scaled, factor=factor, place=place)
    shift = np.median(centers - given, axis=0)
    name = f"they are shifted by ({', '.join(f'{s / h:.1f}' for s in -shift)}) voxels (x, y, z)"
    yield name, lambda c: c + shift


def _scaled(centers: Float, factor: Float | float, place: Float) -> Float:
    """Centres with their distances from a place times a factor; −1 along an axis mirrors them."""
    return place + factor * (centers - place)


def _distance(a: Float, b: Float) -> float:
    return float(np.median(np.linalg.norm(a - b, axis=1)))


def _translations(start: Motions, grid: Volume, where: str) -> Iterable[Finding]:
    """Motions that leave the sample."""
    extent = grid.voxel_size * max(grid.shape)
    lengths = np.linalg.norm(start.translations, axis=1)
    far = np.flatnonzero(lengths > MAX_START_TRANSLATION * extent)  # NaN is not
    if len(far):
        fact = f"{len(far)} of {len(start)} grains move by more than the extent of the volume: other units?"
        some = ", ".join(f"grain {start.labels[k]}: {lengths[k]:.3g} mm" for k in far[:MAX_ROWS_NAMED])
        evidence = f"{some}; the volume is {extent:.3g} mm"
        usable = np.count_nonzero(start.statuses != Status.NOT_FITTED.value)
        level = Level.ERROR if 2 * len(far) > usable else Level.WARNING
        yield Finding(level, START_CHECK, where, fact, evidence, "give translations in the unit of the volume")
