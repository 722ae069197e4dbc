"""The first radiograph of a scan in the terminal, in characters: +z upwards, with the rotation axis' shadow."""

from __future__ import annotations

import numpy as np

from grainmotion.experiment.inspection import FirstViews
from grainmotion.model.volume import Volume
from grainmotion.report.grey_scale import grey_scale
from grainmotion.report.inspection_figure import DrawnScan

SHADES = " .:-=+*#%@"
"""From air to the highest line integral."""
CHARACTER_ASPECT = 2.0  # height of a character over its width
AXIS, POINT = "|", "o"


def terminal_radiograph(first: FirstViews, grid: Volume, *, width: int = 72) -> str:
    """The first radiograph in lines of characters.

    ``|`` is the shadow of the rotation axis, ``o`` the point that is nearest the source; the arrow below tells where it
    goes in the next views.

    Parameters
    ----------
    first : FirstViews
        The radiographs.
    grid : Volume
        Where the sample is.
    width : int
        Characters in a line.

    Returns
    -------
    str
        Lines, the top of the sample first.
    """
    drawn = DrawnScan(first, grid)
    image = drawn.scan.line_integrals[0]
    rows, columns = image.shape
    wide = min(width, columns)
    high = max(1, round(rows * wide / columns / CHARACTER_ASPECT))
    row_of, column_of = (np.arange(rows) * high // rows, np.arange(columns) * wide // columns)
    sums = np.zeros((high, wide))
    np.add.at(sums, (row_of[:, None], column_of[None, :]), np.nan_to_num(image))
    means = sums / (np.bincount(row_of, minlength=high)[:, None] * np.bincount(column_of, minlength=wide)[None, :])
    scale = grey_scale(drawn.scan.line_integrals)
    shade = np.clip((means - scale.low) / max(scale.high - scale.low, 1e-12), 0, 1)
    picture = np.array(list(SHADES))[(shade * (len(SHADES) - 1)).round().astype(int)]
    point, top, bottom = drawn.points[0]
    if np.isfinite([*top, *bottom]).all():
        for k in range(high):
            row = (k + 0.5) * rows / high
            share = (row - top[0]) / (bottom[0] - top[0]) if bottom[0] != top[0] else 0.0
            _mark(picture, k, (top[1] + share * (bottom[1] - top[1])) * wide / columns, AXIS)
    if np.isfinite(point).all():
        _mark(picture, int(point[0] * high / rows), point[1] * wide / columns, POINT)
    lines = ["".join(line) for line in (picture[::-1] if drawn.upright else picture)]
    arrow = {None: "", True: "o moves right -->", False: "<-- o moves left"}[drawn.moves_right]
    edge = f"column 0{arrow:^{max(wide - 8 - len(str(columns - 1)), len(arrow) + 2)}}{columns - 1}"
    return "\n".join(["z up", *lines, edge])


def _mark(picture: np.ndarray, row: int, column: float, mark: str) -> None:
    """Put a mark where it lies within the picture."""
    if 0 <= row < picture.shape[0] and 0 <= column < picture.shape[1]:
        picture[row, int(column)] = mark
