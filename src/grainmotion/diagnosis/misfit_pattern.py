"""Which views and rows contradict the others, in words."""

from __future__ import annotations

import numpy as np

from grainmotion._typing import Index
from grainmotion.diagnosis.view_consistency import Consistency

OUTLIER = 3.0
"""A view fits much worse than the others if its residual is so many times the median."""
OUTLIER_SHARE = 0.5
"""And at least so much of the largest."""
MAX_OUTLIER_SHARE = 0.1
"""Of the views; if more fit much worse, they are told as a run of views or as all of them."""
RUN_SHARE = 1.5
"""The first, middle or last third of the views stands out if its residual is so many times that of the others."""
MAX_VIEWS_NAMED = 6
"""Views that a sentence names."""


def outlying_views(consistency: Consistency) -> Index:
    """Places of the few views that fit much worse than the others; none if many do.

    A wrong view spoils the half that it belongs to, and with it its neighbours: what fits less than half as badly as
    the worst is not counted.
    """
    by_view = consistency.by_view
    limit = max(OUTLIER * float(np.median(by_view)), OUTLIER_SHARE * float(by_view.max()))
    outliers = np.flatnonzero(by_view > limit)
    return outliers if len(outliers) <= max(1, MAX_OUTLIER_SHARE * len(by_view)) else outliers[:0]


def misfit_pattern(consistency: Consistency, views: Index) -> str:
    """A clause that says which views, or rows, fit worst.

    Parameters
    ----------
    consistency : Consistency
    views : (n,) int array
        Indices of its views in the scan.
    """
    by_view, by_row = consistency.by_view, consistency.by_row
    outliers = outlying_views(consistency)
    if len(outliers):
        worst = outliers[np.argsort(-by_view[outliers])][:MAX_VIEWS_NAMED]
        names = ", ".join(str(k) for k in sorted(views[worst].tolist()))
        ratio = by_view[worst].max() / np.median(by_view)
        return f"{'view' if len(worst) == 1 else 'views'} {names} (from 0) worst, {ratio:.1f} times the median"
    thirds = np.array_split(by_view, 3)
    for k, name in enumerate(("first", "middle", "last")):
        rest = np.concatenate([third for j, third in enumerate(thirds) if j != k])
        if thirds[k].mean() > RUN_SHARE * rest.mean():
            return f"the {name} third of the views fits worst"
    rows = np.flatnonzero(by_row > OUTLIER * np.median(by_row))
    if 0 < len(rows) <= MAX_OUTLIER_SHARE * len(by_row):
        share = rows.mean() / max(len(by_row) - 1, 1)
        return f"some rows fit worst, near {100 * share:.0f} % of the panel's height from row 0"
    return "all views fit badly alike"
