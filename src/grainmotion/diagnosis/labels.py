"""Labels given beside a volume: pieces and necks of each, and whether they lie where the attenuation is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import edt
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.measure import block_reduce

from grainmotion.diagnosis.label_background import background_label
from grainmotion.diagnosis.label_places import best_shift, correlation, small_offset
from grainmotion.diagnosis.orientations import AS_GIVEN, ORIENTATIONS, orientation_code, orientation_name, oriented
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.label_sums import label_sizes
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume
from grainmotion.segmentation.distance_basins import distance_basins
from grainmotion.segmentation.labels import CleanLabels, checked_labels
from grainmotion.segmentation.region_merging import BasinGraph
from grainmotion.segmentation.settings import SegmentSettings

Findings = tuple[Finding, ...]

LABELS_CHECK: Check = "labels"
MAX_LABELS_LISTED = 10
"""Labels that one finding lists."""
MAX_NECK_ONENESS = 0.35
"""Stiffness of the neck of a label, over its smaller part, up to which it holds two touching grains; `segment`
separates grains below 0.7."""
MIN_PART_SHARE = 0.15
"""Smaller of two touching grains in one label, over the label."""
MIN_CONTRAST = 0.1
"""Attenuation in a label over that around it, in units of the step from air to grains, from which it lies on a
grain."""
SHELL = 3.0
"""Thickness of the shell around a label with which it is compared, voxels."""
MIN_CORRELATION_GAIN = 0.08
"""How much better other axes or another place must match labels and volume."""
MAX_LABEL_OFFSET = 0.5
"""Offset of the labels from the volume along an axis, voxels."""
MAX_COARSE_VOXELS = 64
"""Voxels along the longest axis at which labels and volume are compared in all orientations."""


def check_labels(volume: Volume, labels: NDArray[np.integer], where: str = "labels") -> Findings:
    """Findings about labels made by other software.

    Parameters
    ----------
    volume : Volume
        Attenuation.
    labels : (nz, ny, nx) int array
        0 for no grain.
    where : str
        File and key, for the findings.

    Returns
    -------
    tuple of Finding
        Empty if nothing is unusual.
    """
    clean = CleanLabels.of(checked_labels(labels, volume.shape))
    if not clean.labels.any():
        fact = "all labels hold too few voxels to be grains"
        return (Finding(Level.ERROR, LABELS_CHECK, where, fact, remedy="check the labels"),)
    around = background_label(volume, clean.labels)
    if around is not None:
        return (_background(around, where),)
    binary = _binary(clean, where)
    misplaced = _misplaced(volume, clean.labels, where)
    findings = [*_small(clean, where), *binary, *misplaced]
    if not misplaced:
        findings += _over_air(volume, clean.labels, where)
    if not binary:
        findings += [*_pieces(clean, where), *_necks(clean, where)]
    return tuple(findings)


def _background(around: tuple[int, float, float], where: str) -> Finding:
    label, share, level = around
    fact = f"label {label} is what lies around the grains: no grain, but air or a liquid"
    evidence = f"it holds {share:.0%} of all voxels and attenuates {level:.2f} of what the others do"
    remedy = f"give 0 there, as numpy.where(labels == {label}, 0, labels)"
    return Finding(Level.ERROR, LABELS_CHECK, where, fact, evidence, remedy)


def grains_in_doubt(labels: NDArray[np.integer]) -> dict[int, str]:
    """Of each label that holds more than one grain, the reason not to trust its motion."""
    clean = CleanLabels.of(labels)
    doubts = {label: f"its label holds {len(sizes)} separate pieces" for label, sizes in clean.pieces.items()}
    necked = {label: "its label holds two touching grains" for label in necked_labels(clean.labels)}
    return necked | doubts


def in_doubt(motions: Motions, doubts: dict[int, str]) -> Motions:
    """Motions in which labels that hold more than one grain are poorly determined, for that reason."""
    if not doubts:
        return motions
    statuses, reasons = motions.statuses.copy(), list(motions.reasons)
    doubted = np.isin(motions.labels, list(doubts))
    for k, label in enumerate(motions.labels.tolist()):
        if label in doubts and statuses[k] == Status.CONVERGED.value:
            statuses[k] = Status.POORLY_DETERMINED.value
            reasons[k] = f"{doubts[label]}, which may move apart; give each grain its own label"
    return replace(
        motions, statuses=statuses, reasons=tuple(reasons),
        ok_translation=motions.ok_translation & ~doubted, ok_rotation=motions.ok_rotation & ~doubted,
    )  # fmt: skip


def _small(clean: CleanLabels, where: str) -> Iterable[Finding]:
    if clean.dropped:
        fact = f"{_count(clean.dropped, 'label')} of too few voxels to be grains {_were(clean.dropped)} dropped"
        remedy = "remove small objects where the labels were made"
        yield Finding(Level.WARNING, LABELS_CHECK, where, fact, f"labels {_listed(clean.dropped)}", remedy)
    if clean.specks:
        fact = f"specks apart from the grain were dropped from {_count(clean.specks, 'label')}"
        evidence = f"{sum(clean.specks.values())} voxels of labels {_listed(clean.specks)}"
        yield Finding(Level.NOTE, LABELS_CHECK, where, fact, evidence)


def _pieces(clean: CleanLabels, where: str) -> Iterable[Finding]:
    for label, sizes in list(clean.pieces.items())[:MAX_LABELS_LISTED]:
        fact = f"label {label} holds {_grains(len(sizes))}: it has {len(sizes)} separate pieces"
        evidence = f"of {', '.join(str(s) for s in sizes[:MAX_LABELS_LISTED])} voxels"
        yield Finding(Level.WARNING, LABELS_CHECK, where, fact, evidence, "give each grain its own label")


def _necks(clean: CleanLabels, where: str) -> Iterable[Finding]:
    for label, share in list(necked_labels(clean.labels).items())[:MAX_LABELS_LISTED]:
        fact = f"label {label} holds two touching grains: it has a narrow neck"
        evidence = f"{share:.0%} of its voxels lie on one side"
        yield Finding(Level.WARNING, LABELS_CHECK, where, fact, evidence, "give each grain its own label")


def necked_labels(labels: NDArray[np.integer]) -> dict[int, float]:
    """Labels whose largest piece has a neck that `segment` would clearly cut, with the smaller part's share."""
    found = dict[int, float]()
    depth = SegmentSettings().depth
    if min(labels.shape) == 1:
        return found
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None:
            continue
        inside = np.pad(labels[box] == label, 1)
        distance = edt.edt(ndimage.binary_fill_holes(inside), parallel=1)
        basins = distance_basins(distance)
        if basins.max() < 2:
            continue
        parts = BasinGraph.of(distance, basins).merged(depth, MAX_NECK_ONENESS)[basins]
        sizes = np.sort(np.bincount(parts[parts > 0]))[::-1]
        if len(sizes) > 1 and sizes[1] >= MIN_PART_SHARE * sizes.sum():
            pieces = ndimage.label(inside, np.ones((3, 3, 3)))[1]
            if np.count_nonzero(sizes >= MIN_PART_SHARE * sizes.sum()) > pieces:
                found[label] = float(sizes[1] / sizes.sum())
    return found


def _binary(clean: CleanLabels, where: str) -> Iterable[Finding]:
    values = np.flatnonzero(label_sizes(clean.labels))
    values = values[values > 0]
    if len(values) != 1 or min(clean.labels.shape) == 1:
        return []
    label = int(values[0])
    pieces = len(clean.pieces.get(label, (0,)))
    necked = label in necked_labels(clean.labels)
    if pieces < 2 and not necked:
        return []
    fact = f"all labels are {label}: it is a binary image of grain and air, which doesn't tell grains apart"
    evidence = f"one label in {pieces} pieces" if pieces > 1 else "one label with necks"
    remedy = "leave reference.labels out, so that the volume is segmented, [segment] threshold"
    return [Finding(Level.ERROR, LABELS_CHECK, where, fact, evidence, remedy)]


def _over_air(volume: Volume, labels: NDArray[np.integer], where: str) -> Iterable[Finding]:
    """Labels that attenuate no more than what is around them."""
    step = _step(volume, labels)
    low = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None:
            continue
        wide = tuple(slice(max(s.start - int(SHELL), 0), s.stop + int(SHELL)) for s in box)
        inside = labels[wide] == label
        around = (ndimage.distance_transform_edt(~inside) <= SHELL) & (labels[wide] == 0)
        array = volume.array[wide]
        outside = float(array[around].mean()) if around.any() else 0.0
        contrast = (float(array[inside].mean()) - outside) / step if step > 0 else 0.0
        if contrast < MIN_CONTRAST:
            low.append((label, contrast))
    if not low:
        return []
    fact = f"{_count(low, 'label')} {'lies' if len(low) == 1 else 'lie'} on air, or on no more than what is around"
    contrasts = ", ".join(f"{label}: {contrast:.0%}" for label, contrast in low[:MAX_LABELS_LISTED])
    evidence = f"contrast to the voxels around, of that of grains: {contrasts}"
    return [
        Finding(Level.WARNING, LABELS_CHECK, where, fact, evidence, "check these labels; nothing there can be tracked")
    ]


def _step(volume: Volume, labels: NDArray[np.integer]) -> float:
    """From what lies outside all labels to the brightest tenth of the volume's labelled voxels' number."""
    outside = float(np.median(volume.array[labels == 0])) if (labels == 0).any() else 0.0
    share = np.count_nonzero(labels) / labels.size
    return float(np.quantile(volume.array, 1 - share / 2)) - outside


def _misplaced(volume: Volume, labels: NDArray[np.integer], where: str) -> Iterable[Finding]:
    """Labels that would match the volume in another orientation, or at another place."""
    if min(labels.shape) == 1 or (labels > 0).all():
        return []
    factor = max(1, -(-max(labels.shape) // MAX_COARSE_VOXELS))
    mask = block_reduce((labels > 0).astype(np.float32), factor, np.mean)
    array = block_reduce(np.minimum(volume.array, np.quantile(volume.array, 0.999)), factor, np.mean)
    told = correlation(array, mask)
    best, orientation, shift = told, AS_GIVEN, (0, 0, 0)
    may_be_better = correlation(np.sort(array, axis=None), np.sort(mask, axis=None)) > told + MIN_CORRELATION_GAIN
    for candidate in ORIENTATIONS if may_be_better else ():
        changed = oriented(mask, candidate)
        if changed.shape != mask.shape:
            continue
        value, place = best_shift(array, changed)
        if value > best + (MIN_CORRELATION_GAIN if candidate != orientation else 0):
            best, orientation, shift = value, candidate, place
    evidence = f"correlation of labels and volume {told:.2f}, and {best:.2f} then"
    if best > told + MIN_CORRELATION_GAIN:
        if orientation != AS_GIVEN:
            fact = f"the labels do not lie on the grains of the volume: they are {orientation_name(orientation)}"
            remedy = f"give {orientation_code('labels', orientation)} for labels"
            return [Finding(Level.ERROR, LABELS_CHECK, where, fact, evidence, remedy)]
        voxels = ", ".join(str(s * factor) for s in shift)
        fact = f"the labels do not lie on the grains of the volume: they are off by ({voxels}) voxels (z, y, x)"
        return [
            Finding(Level.ERROR, LABELS_CHECK, where, fact, evidence, "shift labels or volume: they are on one grid")
        ]
    offset = small_offset(volume.array, labels, _step(volume, labels))
    if np.abs(offset).max() > MAX_LABEL_OFFSET:
        fact = "the labels are shifted against the volume"
        evidence = f"by about ({', '.join(f'{o:.1f}' for o in offset)}) voxels (z, y, x)"
        return [
            Finding(Level.WARNING, LABELS_CHECK, where, fact, evidence, "shift labels or volume: they are on one grid")
        ]
    return []


def _grains(count: int) -> str:
    return "two grains" if count == 2 else "several grains"


def _count(items: Iterable[object], noun: str) -> str:
    number = len(list(items))
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _were(items: tuple[int, ...]) -> str:
    return "was" if len(items) == 1 else "were"


def _listed(labels: Iterable[int]) -> str:
    numbers = list(labels)
    return ", ".join(str(n) for n in numbers[:MAX_LABELS_LISTED]) + (
        ", ..." if len(numbers) > MAX_LABELS_LISTED else ""
    )
