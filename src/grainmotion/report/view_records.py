"""The radiographs of a state for the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion.report import images
from grainmotion.report.data import StateReport

MAX_PIXELS = 1_600_000  # of all radiographs on the page together: about 2 MB
MAX_IMAGE_PIXELS, MIN_IMAGE_PIXELS = 640_000, 4_000  # of one radiograph


@dataclass(frozen=True)
class ImageBudget:
    """Pixels that one radiograph may have."""

    pixels: int

    @classmethod
    def of(cls, states: Sequence[StateReport]) -> ImageBudget:
        """So many that all radiographs of these states fit on the page."""
        radiographs = 3 * sum(len(state.views) for state in states)
        return cls(int(np.clip(MAX_PIXELS // max(1, radiographs), MIN_IMAGE_PIXELS, MAX_IMAGE_PIXELS)))


def view_records(state: StateReport, budget: ImageBudget) -> list[dict[str, object]]:
    """Caption, geometry (mm), size, binning and images of each view."""
    assert state.residual is not None  # StateReport fills it
    grey = images.grey_scale(state.measured, state.simulated)
    diverging = images.diverging_scale(state.residual)
    rows, columns = state.measured.shape[1:]
    return [
        {
            "caption": view.caption,
            "geometry": _geometry(state, k),
            "rows": rows,
            "columns": columns,
            "binning": view.binned,
            "first_row": state.first_row,
            "images": {name: picture.address for name, picture in view.images},
            "scale": {"grey": [grey.low, grey.high], "residual": [diverging.low, diverging.high]},
            "rms": view.rms if np.isfinite(view.rms) else None,
            "percent": view.percent,
        }
        for k, view in enumerate(images.radiographs(state, grey, diverging, budget.pixels))
    ]


def _geometry(state: StateReport, view: int) -> dict[str, object] | None:
    if state.geometry is None:
        return None
    source, detector, u, v = state.geometry.vectors[view].reshape(4, 3).tolist()
    return {"source": source, "detector": detector, "u": u, "v": v, "beam": state.geometry.beam}
