"""Frames held against their fellows: black, odd or repeated radiographs, flats and darks that do not belong, pixels."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.read_scan import MAX_LEVEL_PIXELS, ReadScan
from grainmotion.diagnosis.stuck_views import stuck_views
from grainmotion.model.finding import Finding, Level
from grainmotion.model.progress import counted

MAX_MASKED_SHARE = 0.01
"""Share of all pixels that may be masked without a warning."""
ODD_LEVEL = 1.3
"""Ratio of the brightest parts of a view and of the views around it from which it is odd."""
EMPTY = 0.1
"""Contrast of a view over the median of all, below which it shows no sample: 0.5 and more in sound scans, 0.02 to 0.05
in flats among them."""
LEVEL_STEPS = 8.0
"""The same in median steps between neighbouring views."""
NEIGHBOURS = 2
"""Views before and after a view that it is compared with."""
MIN_VIEWS_IN_ORDER = 16
"""Views from which neighbours can be expected to be alike."""
UNLIKE = 1.8
"""Difference of a view from the more similar of its neighbours over the median of all views from which it is odd.

Sound scans gave up to 1.4; a radiograph of a view 60 to 120 degrees away at least 2.2.  Where grains lie in rows,
views along them differ as much."""
UNLIKE_AROUND = 0.8
"""The same over the difference of the views on either side of it.

Along rows of grains 0.5 in steps of up to 1.5 degrees, 0.5 to 1 in steps of 3; at least 0.85 for a radiograph of
another view, in steps of 7.5 degrees."""
MAX_ODD_SHARE = 0.2
"""Share of odd views; if there are more, the odd thing is the scan."""
NAMED_VIEWS = 8
"""Views that a sentence names."""


def frame_findings(read: ReadScan) -> tuple[Finding, ...]:
    """All checks of frames and pixels."""
    checks: tuple[Callable[[ReadScan], Iterable[Finding]], ...] = (
        _beam_images, _pixels, _black, _empty, _odd_levels, _repeated, stuck_views, _unlike,
    )  # fmt: skip
    return tuple(finding for check in counted(checks) for finding in check(read))


def _beam_images(read: ReadScan) -> Iterable[Finding]:
    """Flats and darks that were left out of the mean."""
    causes = {
        "flats": "far dimmer or brighter than the others (empty, the shutter closed), or with a shadow in them "
        "(the sample in the beam)",
        "darks": "much brighter than the others (the shutter open)",
    }
    for name, numbers in (("flats", read.pixels.flats_left_out), ("darks", read.pixels.darks_left_out)):
        stack = read.flats if name == "flats" else read.darks
        if numbers and stack is not None:
            means = [float(np.nanmean(frame)) for frame in stack]
            rest = float(np.median(np.delete(means, numbers)))
            yield Finding(
                Level.WARNING, "beam-images", read.names[name],
                f"{len(numbers)} of {len(stack)} {name} left out of the mean: {causes[name]}",
                f"{_numbered(name, numbers)} (from 0), mean {_listed(means[k] for k in numbers)}; others {rest:.4g}",
                f"look at these files, and name only good {name}",
            )  # fmt: skip


def _pixels(read: ReadScan) -> Iterable[Finding]:
    """Pixels that were masked."""
    pixels = read.pixels
    share = pixels.bad / max(pixels.total, 1)
    if share > MAX_MASKED_SHARE:
        remedy = "check flats, darks and exposure"
        yield Finding(Level.WARNING, "pixels", read.names["radiographs"], str(pixels), f"{100 * share:.1f} %", remedy)
    elif pixels.bad:
        yield Finding(Level.NOTE, "pixels", read.names["radiographs"], str(pixels), f"{100 * share:.2g} %")
    if pixels.values_left_out:
        fact = f"{pixels.values_left_out} values are NaN or zingers and were left out of the means"
        yield Finding(Level.NOTE, "pixels", read.names.get("flats", read.names["radiographs"]), fact)


def _black(read: ReadScan) -> Iterable[Finding]:
    """Radiographs without beam."""
    black = np.flatnonzero(read.black)
    if len(black):
        yield Finding(
            Level.ERROR, "frames", read.names["radiographs"],
            f"{_numbered('radiographs', black)} of {len(read.lit)} (from 0): black, as the shutter was closed or files "
            "are empty",
            f"the brightest parts transmit {_listed(read.lit[black])}, those of the others {np.median(read.lit):.3g}",
            f"leave them out: {read.key}.views = a list of the others",
        )  # fmt: skip


def _empty(read: ReadScan) -> Iterable[Finding]:
    """Views of the reference that show no sample, as a flat among the radiographs does."""
    contrast = read.blocks.std(axis=1)
    empty = np.flatnonzero((contrast < EMPTY * np.median(contrast)) & ~read.black)
    if read.key == "reference" and 0 < len(empty) <= MAX_ODD_SHARE * len(contrast):
        yield Finding(
            Level.ERROR, "frames", read.names["radiographs"],
            f"{_numbered('radiographs', empty)} (from 0): without a sample, as a flat among the radiographs; if there "
            "is one image too many, all behind it are told with the angle of another view",
            f"contrast {_listed(contrast[empty])}, of the others {np.median(contrast):.3g}",
            f"leave them out of the files, or of {read.key}.views and the angles",
        )  # fmt: skip


def _odd_levels(read: ReadScan) -> Iterable[Finding]:
    """Views far brighter or darker than those around them."""
    lit = np.flatnonzero(~read.black)
    if len(lit) < MIN_VIEWS_IN_ORDER:
        return
    log = np.log(read.lit[lit])
    change = log - np.array([np.median(np.delete(_near(log, k), min(k, NEIGHBOURS))) for k in range(len(log))])
    odd = np.abs(change) > max(np.log(ODD_LEVEL), LEVEL_STEPS * float(np.median(np.abs(change))))
    if 0 < odd.sum() <= MAX_ODD_SHARE * len(log):
        yield Finding(
            Level.WARNING, "frames", read.names["radiographs"],
            f"{_numbered('radiographs', lit[odd])} (from 0): far brighter or darker than those before and after, by "
            "another exposure, a beam that failed, or files of another scan",
            f"by factors of {_listed(np.exp(change[odd]))}",
            f"look at them; leave them out by {read.key}.views",
        )  # fmt: skip


def _near(values: Float, k: int) -> Float:
    return values[max(k - NEIGHBOURS, 0) : k + NEIGHBOURS + 1]


def _repeated(read: ReadScan) -> Iterable[Finding]:
    """One radiograph given for two different views."""
    seen: dict[bytes, int] = {}
    pairs: list[tuple[int, int]] = []
    step = max(1, read.images[0].size // MAX_LEVEL_PIXELS)
    for k, image in enumerate(counted(read.images)):
        rows = image[:: max(1, min(step, len(image) // 4))]
        first = seen.setdefault(hashlib.blake2b(np.ascontiguousarray(rows).tobytes(), digest_size=16).digest(), k)
        if first != k and np.ptp(rows) > 0 and np.array_equal(image, read.images[first]):
            pairs.append((first, k))
    vectors = read.scan.geometry.vectors
    tolerance = 1e-6 * float(np.abs(vectors).max())
    pairs = [(a, b) for a, b in pairs if np.abs(vectors[a] - vectors[b]).max() > tolerance]
    if pairs and len(pairs) < len(read.images) / 2:
        yield Finding(
            Level.WARNING if len(read.images) >= MIN_VIEWS_IN_ORDER else Level.ERROR, "frames",
            read.names["radiographs"],
            f"{len(pairs)} of the radiographs repeat another one, though of another view: a file was copied twice",
            "copies: " + ", ".join(f"{a} = {b}" for a, b in pairs[:NAMED_VIEWS]),
            f"give the right files, or leave the copies out by {read.key}.views",
        )  # fmt: skip


def _unlike(read: ReadScan) -> Iterable[Finding]:
    """Views that are like neither the one before nor the one after."""
    lit = np.flatnonzero(~read.black)
    if len(lit) < MIN_VIEWS_IN_ORDER:
        return
    differences = neighbour_differences(read.blocks[lit])
    ratio = differences / max(float(np.median(differences)), 1e-12)
    limits = UNLIKE_AROUND * differences_around(read.blocks[lit])
    limits[[0, -1]] *= UNLIKE / UNLIKE_AROUND  # of their one neighbour and the view behind it
    odd = (ratio > UNLIKE) & (differences > limits)
    if 0 < odd.sum() <= MAX_ODD_SHARE * len(ratio):
        yield Finding(
            Level.WARNING, "frames", read.names["radiographs"],
            f"{_numbered('radiographs', lit[odd])} (from 0): unlike those before and after, as files of another view "
            "or scan are, or a sample that moved",
            f"they differ {_listed(ratio[odd])} times as much as usual",
            f"look at them, and at the order of the files; leave them out by {read.key}.views",
        )  # fmt: skip


def neighbour_differences(blocks: Float) -> Float:
    """Difference of each view from the more similar of its two neighbours, but for its level."""
    steps = _differences(blocks, 1)
    before, after = np.concatenate([[np.inf], steps]), np.concatenate([steps, [np.inf]])
    return np.minimum(before, after)


def differences_around(blocks: Float) -> Float:
    """Difference of the views on either side of each; for the first and the last of their neighbour and the next."""
    steps = _differences(blocks, 1)
    return np.concatenate([steps[1:2], _differences(blocks, 2), steps[-2:-1]])


def _differences(blocks: Float, apart: int) -> Float:
    """Root mean square difference of views so many ``apart``, but for their levels."""
    centred = blocks - np.median(blocks, axis=1, keepdims=True)
    return np.asarray(np.sqrt(((centred[apart:] - centred[:-apart]) ** 2).mean(axis=1)))


def _numbered(name: str, numbers: Iterable[int]) -> str:
    """Such as "radiographs 3, 4 and 2 more"."""
    values = [int(k) for k in numbers]
    more = f" and {len(values) - NAMED_VIEWS} more" if len(values) > NAMED_VIEWS else ""
    return f"{name if len(values) > 1 else name[:-1]} {', '.join(map(str, values[:NAMED_VIEWS]))}{more}"


def _listed(values: Iterable[float]) -> str:
    some = [f"{value:.3g}" for value in values]
    return ", ".join(some[:NAMED_VIEWS]) + (", ..." if len(some) > NAMED_VIEWS else "")
