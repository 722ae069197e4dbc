"""Which states the page holds in full: all of them, or as many as keep the page small enough to open."""

from __future__ import annotations

import numpy as np

from grainmotion.report.data import ReportData

MAX_ROWS = 60_000  # of grains, all states together: about 2.3 MB
FEW_STATES = 40  # that are shown even where they have more rows
MOST_ROWS = 200_000  # of those few states: about 8 MB
MIN_STATES, MAX_STATES = 2, 500  # however many grains there are


def states_in_detail(data: ReportData) -> list[int]:
    """Places of the states shown in detail, evenly spread, with the first and the last among them.

    The others are in the summary of all states only.
    """
    grains = max((len(state.motions) for state in data.states), default=0)
    rooms = MAX_ROWS // max(1, grains), min(FEW_STATES, MOST_ROWS // max(1, grains))
    most = min(MAX_STATES, max(MIN_STATES, *rooms))
    if len(data.states) <= most:
        return list(range(len(data.states)))
    places = np.linspace(0, len(data.states) - 1, most)
    return sorted({int(place) for place in np.rint(places)})
