"""Sign and scale of grey values: counts, transmissions or line integrals told as another kind; impossible values."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.read_scan import ReadScan, border_width, borders, middle_of
from grainmotion.model.finding import Finding, Level
from grainmotion.model.progress import counted

MIN_COUNT = 20.0
"""Level of an image above which its values can only be counts."""
AIR_TRANSMISSION = (0.8, 1.25)
"""Transmission of air beside the sample; other beams are another kind of value."""
MAX_PLAUSIBLE_LINE_INTEGRAL = 6.0
"""exp(-6) = 0.25 % of the beam; more in any number of pixels is implausible.  Sound scans: up to 3."""
MAX_OPAQUE_SHARE = 1e-3
"""Share of the pixels that may be that opaque."""
MIN_SAMPLE_CONTRAST = 0.03
"""Difference of the centre of the panel and its border that shows where the sample is."""
BELOW_AIR = 0.05
"""Line integral below that of air of a part of the panel from which it is brighter than air can be."""
MAX_BELOW_AIR_SHARE = 0.03
"""Share of such parts."""
MIN_LEVEL_OF_RADIOGRAPHS = -0.3
"""Line integral of the median pixel, sample included, of a beam that is a third brighter than in the flats; beams of
laboratories drift by some per cent."""
HALF_RANGE = 32768.0
"""What is added when signed 16-bit numbers are written as unsigned ones."""
HALF_RANGE_TOLERANCE = 0.02
"""Relative tolerance of it, with the noise and the drift of the beam.

It is asked at the border of the panel, whether air is seen there or not: an offset makes a beam that is brighter on one
side look as if the sample were there."""
MIN_STRETCHED, MAX_AT_TOP = 3, 0.05
"""Images that must use the whole range of their numbers to be called stretched, and the largest share of their pixels
at its top: 0.0002 to 0.01 where each has its own contrast, more where the camera is saturated."""
STRETCHED = (
    "each image fills the whole range of its numbers: they were written with automatic contrast, and no two have the "
    "same scale"
)
TO_UNSCALE = "export the counts without scaling, all images alike"
MAX_OF_BYTE = 255
MAX_SAMPLE = 8
"""Views from which the kind of value is judged."""


def likely_kind(images: NDArray) -> str:
    """What grey values look like: "counts", "transmission", "line-integrals", or "" if that cannot be told.

    Air at the border is 1 in transmissions and 0 in line integrals; the sample, in the middle, is darker in the former
    and brighter in the latter.
    """
    border, middle, top = _levels(images)
    if top > MIN_COUNT:
        return "counts"
    low, high = AIR_TRANSMISSION
    if low < border < high and middle < border - MIN_SAMPLE_CONTRAST and top < 1.5 * high:
        return "transmission"
    if abs(border) < 1 - low and middle > border + MIN_SAMPLE_CONTRAST:
        return "line-integrals"
    return ""


def _levels(images: NDArray) -> tuple[float, float, float]:
    """Medians of the border and of the middle of the panel, and the brightest parts."""
    some = images[np.unique(np.linspace(0, len(images) - 1, min(len(images), MAX_SAMPLE)).astype(int))].astype(float)
    columns = some.shape[2]
    edges = np.concatenate([some[:, :, part] for part in borders(border_width(columns))], axis=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of nothing but NaN; it is like nothing then
        values = [np.nanmedian(edges), np.nanmedian(some[:, *middle_of(some)]), np.nanpercentile(some, 99)]
    return float(values[0]), float(values[1]), float(values[2])


def wrong_kind(kind: str, images: NDArray, flats: NDArray | None) -> tuple[str, str] | None:
    """The kind that the grey values look like, if it is not the one told, and the numbers behind it."""
    found = likely_kind(images)
    if found in ("", kind) or (kind == "counts" and flats is None):
        return None
    border, middle, top = _levels(images)
    if kind == "counts" and flats is not None and np.nanmedian(flats) < MIN_COUNT * max(top, 1.0):
        return None
    evidence = f"their median is {border:.4g} at the border of the panel and {middle:.4g} in its middle"
    return found, evidence


def stretched(images: NDArray) -> bool:
    """Whether nearly all images use the whole range of their numbers, each from a place and to a place of its own.

    So does what viewers write with automatic contrast; a dead and a hot pixel are at the same places in all images.
    """
    counted = np.issubdtype(images.dtype, np.unsignedinteger)
    if len(images) < MIN_STRETCHED or not (counted or np.issubdtype(images.dtype, np.floating)):
        return False
    some = images[np.unique(np.linspace(0, len(images) - 1, min(len(images), MAX_SAMPLE)).astype(int))]
    flat, top = some.reshape(len(some), -1), np.iinfo(images.dtype).max if counted else 1
    whole = (flat.min(axis=1) == 0) & (flat.max(axis=1) == top) & ((flat == top).mean(axis=1) < MAX_AT_TOP)
    moves = all(len(set(places)) > 1 for places in (flat.argmin(axis=1).tolist(), flat.argmax(axis=1).tolist()))
    return bool(whole.all()) and moves


def scaled(kind: str, images: NDArray, flats: NDArray | None) -> str:
    """How radiographs were scaled when they were written, if they were: no counts can be found again."""
    if stretched(images):
        return STRETCHED
    if kind == "counts" and flats is not None and images.dtype == np.uint8 and np.nanmedian(flats) > MAX_OF_BYTE:
        fact = "the radiographs have 8 bits, 255 at most, and the flats more"
        return f"{fact} ({np.nanmedian(flats):.0f}): the radiographs were scaled when they were written"
    return ""


def grey_value_findings(read: ReadScan) -> tuple[Finding, ...]:
    """All checks of grey values."""
    checks: tuple[Callable[[ReadScan], Iterable[Finding]], ...] = (
        _scaled, _kind, _sign, _beam_scale, _offset, _opaque, _pile_up, _eight_bits,
    )  # fmt: skip
    return tuple(finding for check in counted(checks) for finding in check(read))


def _scaled(read: ReadScan) -> Iterable[Finding]:
    """Radiographs that were scaled when they were written."""
    fact = scaled(read.kind, read.images, read.flats)
    if fact:
        yield Finding(Level.ERROR, "kind", read.names["radiographs"], fact, "", TO_UNSCALE)


def _kind(read: ReadScan) -> Iterable[Finding]:
    """Another kind than the one told."""
    wrong = wrong_kind(read.kind, read.images, read.flats)
    if wrong is not None:
        yield Finding(
            Level.ERROR, "kind", read.names["radiographs"],
            f'the values look like {wrong[0]}, but are told as kind "{read.kind}"', wrong[1],
            f'set {read.key}.kind = "{wrong[0]}"',
        )  # fmt: skip


def _sign(read: ReadScan) -> Iterable[Finding]:
    """Radiographs that are brighter than air can be."""
    if wrong_kind(read.kind, read.images, read.flats) is not None:
        return
    air = min(float(np.median(read.sides)), 0.0)
    middle = float(np.median(read.scan.line_integrals[:, *middle_of(read.images)]))
    noise = float(np.median(np.abs(np.diff(read.blocks, axis=0)))) if len(read.blocks) > 1 else 0.0
    levels = np.minimum(read.sides.mean(axis=1, keepdims=True), 0.0)
    share = float((read.blocks < levels - BELOW_AIR - noise).mean())
    if read.sees_air and middle < air - BELOW_AIR:
        yield Finding(
            Level.ERROR, "sign", read.names["radiographs"],
            "the sample is brighter than air: the sign of the line integrals or the grey values are inverted, or flats "
            "and radiographs are exchanged",
            f"the median line integral is {middle:.3f} in the middle of the panel and {air:.3f} at its sides",
            "give -ln(I/I0), or counts that fall where the sample absorbs",
        )  # fmt: skip
    elif share > MAX_BELOW_AIR_SHARE:
        yield Finding(
            Level.WARNING, "sign", read.names["radiographs"],
            "parts of the radiographs are brighter than the flats: flats with the sample in the beam, or of another "
            "place of the panel or beam",
            f"{100 * share:.0f} % of the panel have a line integral that is lower than that of air by {BELOW_AIR:g}",
            f"check {read.key}.flats",
        )  # fmt: skip


def _beam_scale(read: ReadScan) -> Iterable[Finding]:
    """Radiographs that are far brighter than the open beam as a whole: another exposure, or another scale of counts."""
    level = float(np.median(read.thinned[~read.black])) if not read.black.all() else 0.0
    other = (finding for check in (_kind, _sign, _offset) for finding in check(read))
    if level > MIN_LEVEL_OF_RADIOGRAPHS or next(other, None) is not None:
        return
    yield Finding(
        Level.WARNING, "beam-level", read.names["radiographs"],
        "the radiographs as a whole are brighter than the open beam: flats or the white level are of another exposure, "
        "or of another scale",
        f"the median pixel has {np.exp(-level):.3g} times the counts of the open beam",
        f"check {read.key}.flats, or {read.key}.white_level",
    )  # fmt: skip


def _offset(read: ReadScan) -> Iterable[Finding]:
    """Half of the range of 16 bits between radiographs and flats."""
    if read.kind != "counts" or read.flats is None:
        return
    border, _, _ = _levels(read.images)
    flat, _, _ = _levels(read.flats)
    if abs(border - flat - HALF_RANGE) < HALF_RANGE_TOLERANCE * (HALF_RANGE + abs(flat)):
        yield Finding(
            Level.ERROR, "offset", read.names["radiographs"],
            "the radiographs are brighter than the flats by half of the range of 16 bits: signed numbers were "
            "written as unsigned ones",
            f"air has {border:.0f} counts, the flats {flat:.0f}",
            f"subtract {HALF_RANGE:.0f} from the radiographs",
        )  # fmt: skip


def _opaque(read: ReadScan) -> Iterable[Finding]:
    """Line integrals that hardly any beam survives."""
    share = float((read.thinned[~read.black] > MAX_PLAUSIBLE_LINE_INTEGRAL).mean())
    if share > MAX_OPAQUE_SHARE and wrong_kind(read.kind, read.images, read.flats) is None:
        yield Finding(
            Level.WARNING, "opaque", read.names["radiographs"],
            "hardly any beam reaches parts of the panel: the sample is opaque, or the darks or the kind are wrong",
            f"{100 * share:.2g} % of the line integrals are above {MAX_PLAUSIBLE_LINE_INTEGRAL:g}, 0.25 % of the beam",
            f"check {read.key}.darks, and that these are {read.kind}",
        )  # fmt: skip


def _pile_up(read: ReadScan) -> Iterable[Finding]:
    """The top of the camera's range, found in the counts."""
    if read.top is not None and read.kind == "counts":
        stacks = [read.images] if read.flats is None else [read.images, read.flats]
        share = sum(int(np.count_nonzero(s >= read.top)) for s in stacks) / sum(s.size for s in stacks)
        yield Finding(
            Level.WARNING, "saturation", read.names["radiographs"],
            f"many pixels have the largest value of the camera, {read.top:.0f}: they are saturated, and were masked",
            f"{100 * share:.1f} % of the pixels of radiographs and flats",
            f"expose for a shorter time; set {read.key}.saturation to {read.top:.0f}, or higher if that is not the top",
        )  # fmt: skip


def _eight_bits(read: ReadScan) -> Iterable[Finding]:
    """Counts of 256 levels."""
    if read.kind == "counts" and read.images.dtype in (np.uint8, np.int8):
        yield Finding(
            Level.NOTE, "eight-bit", read.names["radiographs"],
            "the counts have 8 bits, 256 levels: weak attenuation is lost in the steps between them",
            remedy="give the camera's own 12 or 16 bits if there are any",
        )  # fmt: skip
