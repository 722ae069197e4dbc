"""The radiographs of all states within a share of the page."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Image
from grainmotion.model.progress import counted
from grainmotion.report.data import StateReport
from grainmotion.report.embedding import embed
from grainmotion.report.image_coding import Coding, block_means, row_differences

RADIOGRAPH_CHARACTERS = 6_000_000
"""Of the page, for all radiographs together."""
LEAST_VIEW_PIXELS = 4_096
"""Of one radiograph: with fewer, nothing is to be seen on it."""
CLIPPED = 0.001
"""Share of the pixels that are darker, and of those that are brighter, than the scale on which a view is shown."""


@dataclass(frozen=True)
class EncodedView:
    """The radiographs of one view: ``record`` for the page's JSON, and the characters that its images take."""

    record: dict[str, object]
    characters: int


def radiograph_records(
    states: Sequence[StateReport], characters: int = RADIOGRAPH_CHARACTERS
) -> list[list[dict[str, object]]]:
    """Radiographs of states, averaged over as many pixels as it takes to fit into a number of characters.

    Where even small images of all states are too many, only states evenly spread over the series keep theirs.

    Parameters
    ----------
    states : sequence of StateReport
        In loading order.
    characters : int
        Of the images of all states together.

    Returns
    -------
    list of lists of dict
        One record a state and view: ``caption``, ``geometry`` (mm, or None), ``rows``, ``columns`` (of the
        radiograph), ``first_row``, ``rms``, ``percent`` and ``images``: ``simulated`` (row differences) and
        ``residual``, highest row (z up) first, or None where the state keeps none.  With images come ``binning`` (edge
        in pixels of the blocks that were averaged), ``coding`` (see `image_coding.Coding`), ``range`` and ``limit``
        (lowest and highest line integral, and largest residual, to show).
    """
    kept = list(range(len(states)))
    views = sum(len(state.measured) for state in states)
    pixels = max(LEAST_VIEW_PIXELS, characters / max(1, views))
    while True:
        encoded = {k: _encoded(states[k], pixels) for k in counted(kept)}
        total = sum(view.characters for of_state in encoded.values() for view in of_state)
        if total <= characters:
            break
        pixels *= 0.95 * characters / total
        if pixels < LEAST_VIEW_PIXELS:
            share = pixels / LEAST_VIEW_PIXELS
            pixels = LEAST_VIEW_PIXELS
            kept = _evenly_spread(kept, max(1, min(len(kept) - 1, int(share * len(kept)))))
            if len(kept) == 1:
                encoded = {k: _encoded(states[k], pixels) for k in kept}
                break
    left_out = [[_left_out(state, k) for k in range(len(state.measured))] for state in states]
    return [[view.record for view in encoded[k]] if k in encoded else left_out[k] for k in range(len(states))]


def _encoded(state: StateReport, pixels: float) -> list[EncodedView]:
    """The views of a state with at most so many pixels each."""
    rows, columns = state.measured.shape[1:]
    edge = max(1, math.ceil(math.sqrt(rows * columns / pixels)))
    return [_encoded_view(state, k, edge) for k in counted(range(len(state.measured)))]


def _encoded_view(state: StateReport, view: int, edge: int) -> EncodedView:
    assert state.residual is not None  # StateReport fills it
    upwards = slice(None, None, -1 if state.first_row == "bottom" else 1)
    residual = state.residual[view][upwards]
    simulated = np.where(np.isfinite(residual), state.simulated[view][upwards], np.nan)
    simulated, residual = (block_means(image, edge) for image in (simulated, residual))
    coding = Coding.of(simulated, residual)
    images = {
        "simulated": embed(row_differences(coding.simulated_bytes(simulated))),
        "residual": embed(coding.residual_bytes(residual)),
    }
    record = {
        **_left_out(state, view),
        "binning": edge,
        "coding": dataclasses.asdict(coding),
        "range": _range(simulated, simulated + residual),
        "limit": _limit(residual),
        "images": images,
    }
    return EncodedView(record, sum(len(str(image["data"])) for image in images.values()))


def _left_out(state: StateReport, view: int) -> dict[str, object]:
    """The record of a view without images."""
    assert state.residual is not None
    rms, measured_rms = (_rms(images[view]) for images in (state.residual, state.measured))
    return {
        "caption": state.views[view],
        "geometry": _geometry(state, view),
        "rows": state.measured.shape[1],
        "columns": state.measured.shape[2],
        "first_row": state.first_row,
        "images": None,
        "rms": rms if math.isfinite(rms) else None,
        "percent": 100 * rms / measured_rms if measured_rms > 0 and math.isfinite(rms) else None,
    }


def _geometry(state: StateReport, view: int) -> dict[str, object] | None:
    """The view's 12 numbers, mm, by name; None where the report was made without."""
    if state.geometry is None:
        return None
    source, detector, u, v = state.geometry.vectors[view].reshape(4, 3).tolist()
    return {"source": source, "detector": detector, "u": u, "v": v, "beam": state.geometry.beam}


def _evenly_spread(items: list[int], count: int) -> list[int]:
    """So many of the items, the last and (from two on) the first among them."""
    places = np.linspace(len(items) - 1, 0, count).round().astype(int)
    return [items[k] for k in sorted(set(places.tolist()))]


def _range(*images: Image) -> list[float]:
    """Lowest and highest value to show, from 0 where that is near the lowest."""
    values = np.concatenate([image[np.isfinite(image)].ravel() for image in images])
    if values.size == 0:
        return [0.0, 1.0]
    low, high = np.quantile(values, [CLIPPED, 1 - CLIPPED])
    if -0.1 * high < low < 0.5 * high:
        low = 0.0
    return [float(f"{low:.4g}"), float(f"{high if high > low else low + 1:.4g}")]


def _limit(residual: Image) -> float:
    """Size of the residual that is shown in the strongest colour."""
    values = np.abs(residual[np.isfinite(residual)])
    limit = float(np.quantile(values, 1 - 2 * CLIPPED)) if values.size else 0.0
    return float(f"{limit:.4g}") if limit > 0 else 1.0


def _rms(image: Image) -> float:
    values = image[np.isfinite(image)].astype(float)
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan
