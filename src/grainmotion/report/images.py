"""Arrays to PNG images inside the page, with their scales and captions."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from grainmotion._typing import Image as Array
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_images
from grainmotion.report.data import StateReport

SLICE_PIXELS = 160_000  # of one slice of the volume
TRANSPARENT = 255  # palette index of pixels without a value
PALETTES = {"grey": "gray", "diverging": "RdBu_r"}


@dataclass(frozen=True)
class Picture:
    """An image of the page as a ``data:`` address, with a description for readers who cannot see it."""

    address: str
    description: str


@dataclass(frozen=True)
class Slice:
    """A central slice of the reference volume, and of its labels."""

    caption: str
    images: tuple[Picture, ...]


@dataclass(frozen=True)
class View:
    """The radiographs of one view, named measured, simulated and residual.

    ``rms`` is the residual's root mean square, ``percent`` that of the measured line integrals (None where they
    vanish), ``binned`` the pixels along the edge of a block that was averaged.
    """

    caption: str
    images: tuple[tuple[str, Picture], ...]
    rms: float
    percent: float | None
    binned: int


@dataclass(frozen=True)
class GreyScale:
    """A linear colour scale from ``low`` to ``high``; ``palette`` is "grey" or "diverging"."""

    low: float
    high: float
    palette: str = "grey"


def grey_scale(*images: Array) -> GreyScale:
    """One grey scale for several images, from 0 or the darkest to the brightest; 1 pixel in 500 clipped."""
    values = np.concatenate([image[np.isfinite(image)].ravel() for image in images])
    if values.size == 0:
        return GreyScale(0.0, 1.0)
    low, high = np.percentile(values, [0.1, 99.9])
    if 0 < low < 0.5 * high:
        low = 0.0
    return GreyScale(float(low), float(high) if high > low else float(low) + 1.0)


def diverging_scale(images: Array) -> GreyScale:
    """A scale symmetric about 0 that clips one pixel in 500."""
    values = np.abs(images[np.isfinite(images)])
    limit = float(np.percentile(values, 99.8)) if values.size else 0.0
    return GreyScale(-limit, limit, "diverging") if limit > 0 else GreyScale(-1.0, 1.0, "diverging")


def shrink(image: Array, pixels: int) -> tuple[Array, int]:
    """The image averaged over k × k blocks, k the least that leaves at most ``pixels``; and k."""
    rows, columns = image.shape
    k = max(1, math.ceil(math.sqrt(rows * columns / pixels)))
    if k == 1:
        return image, 1
    padded = np.pad(image.astype(float), ((0, -rows % k), (0, -columns % k)), mode="edge")
    return binned_images(padded[None], k)[0], k


def png(image: Array, scale: GreyScale) -> str:
    """A ``data:`` address of the image; pixels that are not finite are transparent."""
    finite = np.isfinite(image)
    unit = (np.where(finite, image, 0) - scale.low) / (scale.high - scale.low)
    index = np.where(finite, np.clip(np.rint(unit * (TRANSPARENT - 1)), 0, TRANSPARENT - 1), TRANSPARENT)
    colours = colormaps[PALETTES[scale.palette]](np.linspace(0, 1, TRANSPARENT))[:, :3]
    return _encode(index.astype(np.uint8), np.vstack([colours, [[0.5, 0.5, 0.5]]]))


def label_png(labels: NDArray[np.integer]) -> str:
    """A ``data:`` address of a slice of labels; neighbours in number differ in colour, 0 is transparent."""
    wheel = colormaps["turbo"]((np.arange(64) * 0.618034) % 1)[:, :3]
    index = np.where(labels > 0, labels % 64, TRANSPARENT).astype(np.uint8)
    palette = np.vstack([wheel, np.full((TRANSPARENT + 1 - 64, 3), 0.5)])
    return _encode(index, palette)


def palette_png(palette: str) -> str:
    """A ``data:`` address of a colour bar, low on the left."""
    return png(np.linspace(0, 1, TRANSPARENT)[None, :], GreyScale(0.0, 1.0, palette))


def central_slices(volume: Volume, labels: NDArray[np.integer] | None, scale: GreyScale) -> list[Slice]:
    """The three central slices of a volume, the upper axis upwards, with those of its labels if given."""
    slices = []
    for axis, axes in enumerate(("x →, y ↑ at mid z", "x →, z ↑ at mid y", "y →, z ↑ at mid x")):
        image = np.take(volume.array, volume.shape[axis] // 2, axis)[::-1]
        pictures = [Picture(png(shrink(image, SLICE_PIXELS)[0], scale), f"attenuation, {axes}")]
        if labels is not None:
            step = max(1, math.ceil(math.sqrt(image.size / SLICE_PIXELS)))
            chosen = np.take(labels, labels.shape[axis] // 2, axis)[::-1][::step, ::step]
            pictures.append(Picture(label_png(chosen), f"labels, {axes}"))
        height, width = (n * volume.voxel_size for n in image.shape)
        slices.append(Slice(f"{axes}: {width:.4g} × {height:.4g} mm", tuple(pictures)))
    return slices


def radiographs(state: StateReport, grey: GreyScale, diverging: GreyScale, pixels: int) -> list[View]:
    """The three images of each view, each of at most ``pixels`` pixels."""
    assert state.residual is not None  # StateReport fills it
    views = []
    for k, caption in enumerate(state.views):
        stacks = (("measured", state.measured, grey), ("simulated", state.simulated, grey))
        named, binned = [], 1
        for name, stack, scale in (*stacks, ("residual", state.residual, diverging)):
            image, binned = shrink(stack[k][::-1] if state.first_row == "bottom" else stack[k], pixels)
            named.append((name, Picture(png(image, scale), f"{name}, {caption}")))
        rms, measured_rms = _rms(state.residual[k]), _rms(state.measured[k])
        percent = 100 * rms / measured_rms if measured_rms > 0 else None
        views.append(View(caption, tuple(named), rms, percent, binned))
    return views


def _rms(image: Array) -> float:
    values = image[np.isfinite(image)].astype(float)
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _encode(index: NDArray[np.uint8], palette: Array) -> str:
    picture = Image.fromarray(np.ascontiguousarray(index), mode="P")
    picture.putpalette(np.rint(palette * 255).astype(np.uint8).tobytes())
    stream = io.BytesIO()
    picture.save(stream, "PNG", transparency=TRANSPARENT, optimize=False, compress_level=9)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()
