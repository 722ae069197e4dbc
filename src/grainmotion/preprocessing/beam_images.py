"""Mean flats and darks, without frames and single values that do not belong to them.

A flat that is empty, was taken with the shutter closed or with the sample in the beam, and a dark taken with the
shutter open, are left out if other frames show it; so are values that are NaN or far brighter than in all other frames
(zingers).  Frames that agree are averaged as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.errors import InputError

Mask = NDArray[np.bool_]

LEVELS = (0.5, 2.0)
"""Level of a flat over that of the upper quarter; others are left out.  Beams drift by a few per cent."""
MAX_DARK_LEVEL = 0.1
"""Level of a dark above the lower quarter of the darks, as a share of the beam; others are left out."""
SHADED = 0.9
"""Ratio of a part of a flat to the same part of the other flats below which it is in a shadow."""
MAX_SHADED_SHARE = 0.02
"""Share of a flat in a shadow from which it is left out."""
SHADE_SIGMAS = 5.0
"""Distance of a shadow from the other parts of its flat, in robust standard deviations."""
FLAT_BLOCKS = 32
"""Parts of a flat along each side."""
ZINGER_SIGMAS = 10.0
"""Distance of a zinger from the mean of the other frames in standard deviations of the noise."""
MIN_ZINGER = (0.1, 0.01)
"""Least distance of a zinger in a flat and in a dark, as a share of the beam."""
MAX_ROUNDS = 5
"""Zingers of one pixel that are left out."""
MAX_LEVEL_SAMPLE = 1 << 16
"""Pixels from which the level of a frame is estimated."""
MAX_MISSING_SHARE = 0.1
"""Share of NaN and infinite values from which an image cannot be used; gaps between modules take 5 to 8 %."""


@dataclass(frozen=True, eq=False)
class BeamImage:
    """A mean flat or dark."""

    mean: Float
    saturated: Mask  # pixels at the top of the camera's range in any of the frames
    missing: Mask  # pixels without any value
    left_out: tuple[int, ...] = ()  # frames, from 0
    values: int = 0  # single values of the other frames


@dataclass(frozen=True, eq=False)
class _Frames:
    """Flats or darks as they are averaged."""

    stack: NDArray
    left_out: tuple[int, ...] = ()

    @property
    def kept(self) -> NDArray:
        """The frames that belong to the mean."""
        if not self.left_out:
            return self.stack
        return np.delete(self.stack, self.left_out, axis=0)


def mean_beam_images(flats: NDArray, darks: NDArray | None, top: float | None) -> tuple[BeamImage, BeamImage | None]:
    """Mean flat and mean dark.

    Parameters
    ----------
    flats : (n, rows, columns) array
        Images of the open beam.
    darks : (n, rows, columns) array, optional
        Images of no beam.
    top : float, optional
        Count from which a pixel of the flats is saturated.

    Returns
    -------
    flat, dark : BeamImage
        The means, and what was left out of them.

    Raises
    ------
    InputError
        If more than 10 % of an image's values are NaN or infinite.
    """
    levels = _levels(flats)
    dark_levels = np.zeros(1) if darks is None else _levels(darks)
    dark_level = float(np.percentile(dark_levels, 25, method="lower"))
    beam = float(np.percentile(levels, 75, method="higher")) - dark_level
    if beam <= 0:  # mixed up; the caller says so
        dark = None if darks is None else _mean("darks", _Frames(darks), None, np.inf)
        return _mean("flats", _Frames(flats), top, np.inf), dark
    odd = np.abs(np.log(np.maximum((levels - dark_level) / beam, 1e-9))) > np.log(LEVELS[1])
    frames = _Frames(flats, tuple(int(k) for k in np.flatnonzero(odd)))
    shaded = _shaded(frames.kept - dark_level) if len(frames.kept) > 1 else np.zeros(len(frames.kept), bool)
    if not shaded.all():
        numbers = np.flatnonzero(~odd)[shaded]
        frames = replace(frames, left_out=tuple(sorted({*frames.left_out, *(int(k) for k in numbers)})))
    flat = _mean("flats", frames, top, MIN_ZINGER[0] * beam)
    if darks is None:
        return flat, None
    bright = np.flatnonzero(dark_levels - dark_level > MAX_DARK_LEVEL * beam)
    return flat, _mean("darks", _Frames(darks, tuple(int(k) for k in bright)), None, MIN_ZINGER[1] * beam)


def _levels(stack: NDArray) -> Float:
    """Upper quartile of each frame; 0 for one without any value."""
    step = max(1, int(np.sqrt(stack[0].size / MAX_LEVEL_SAMPLE)))
    thinned = stack[:, ::step, ::step].reshape(len(stack), -1).astype(float)
    finite = [frame[np.isfinite(frame)] for frame in thinned]
    return np.array([np.percentile(values, 75) if len(values) else 0.0 for values in finite])


def _shaded(flats: NDArray) -> Mask:
    """Which flats have the shadow of something in them that the others do not have."""
    rows, columns = (max(1, side // FLAT_BLOCKS) for side in flats.shape[1:])
    height, width = flats.shape[1] // rows, flats.shape[2] // columns
    cut = flats[:, : height * rows, : width * columns]
    blocks = np.nan_to_num(cut).reshape(len(flats), height, rows, width, columns).mean(axis=(2, 4), dtype=float)
    typical = np.percentile(blocks, 75, axis=0, method="higher")
    ratio = (blocks / np.where(typical > 0, typical, np.inf)).reshape(len(flats), -1)
    ratio /= np.maximum(np.percentile(ratio, 90, axis=1), 1e-9)[:, None]
    median = np.median(ratio, axis=1)
    spread = 1.4826 * np.median(np.abs(ratio - median[:, None]), axis=1)
    noise = float(np.percentile(spread, 25))  # of a flat without a shadow
    found: Mask = (ratio < min(SHADED, 1 - SHADE_SIGMAS * noise)).mean(axis=1) > MAX_SHADED_SHARE
    return found


def _mean(name: str, frames: _Frames, top: float | None, min_zinger: float) -> BeamImage:
    """Mean of the frames that are left, without NaN and zingers."""
    stack = frames.kept
    saturated: Mask = np.any(stack >= (np.inf if top is None else top), axis=0)
    used = np.isfinite(stack)
    share = float((~used).mean(axis=(1, 2)).max())
    if share > MAX_MISSING_SHARE:
        raise InputError(name, f"{100 * share:.0f} % of the values are NaN or infinite", f"give other {name}")
    clean = bool(used.all())
    if len(stack) > 1 and np.isfinite(min_zinger):
        zingers = _zingers(stack, used, min_zinger)
        clean &= not zingers.any()
        used &= ~zingers
    missing = np.zeros(stack.shape[1:], bool)
    if clean:
        mean = stack.mean(axis=0, dtype=float)
    else:
        number = used.sum(axis=0)
        missing = number == 0
        mean = np.sum(stack, axis=0, dtype=float, where=used) / np.maximum(number, 1)
    return BeamImage(mean, saturated, missing, frames.left_out, int((~used).sum()))


def _zingers(stack: NDArray, used: Mask, least: float) -> Mask:
    """Values that are far brighter than the mean of the same pixel in the other frames."""
    found = np.zeros(stack.shape, bool)
    values = np.where(used, stack, 0).astype(np.float32)
    step = values[1] - values[0]
    noise = float(1.4826 * np.median(np.abs(step - np.median(step))) / np.sqrt(2))
    limit = least + ZINGER_SIGMAS * noise
    total, number = values.sum(axis=0, dtype=float), used.sum(axis=0)
    for _ in range(MAX_ROUNDS):
        highest = np.argmax(values, axis=0)
        top = np.take_along_axis(values, highest[None], axis=0)[0]
        others = (total - top) / np.maximum(number - 1, 1)
        rows, columns = np.nonzero((top > others + limit) & (number > 1))
        if len(rows) == 0:
            break
        frame = highest[rows, columns]
        total[rows, columns] -= values[frame, rows, columns]
        number[rows, columns] -= 1
        values[frame, rows, columns] = 0
        found[frame, rows, columns] = True
    return found
