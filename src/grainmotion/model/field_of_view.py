"""FieldOfView: which part of the sample the reference scan saw, and in how many of its views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.summary import Summarised
from grainmotion.model.view_shifts import ViewShifts

MAX_FIELD_VIEWS = 48
"""Views, evenly spaced, from which shares are counted: more change the share of a point by 2 % at most."""
POINTS_TOGETHER = 20_000
"""Points that are projected at once, to bound the memory."""


@dataclass(frozen=True, eq=False, repr=False)
class FieldOfView(Summarised):
    """What the reference scan saw of the sample.

    Attributes
    ----------
    geometry : Geometry
        Views of the reference scan, or `MAX_FIELD_VIEWS` of them.
    radius : float
        Radius of the upright cylinder that holds the sample (its outline), mm.
    axis : (float, float)
        x and y of the cylinder's axis, mm.
    above, below, beside : bool
        Whether the sample goes on beyond the upper border of the field, its lower border, and its sides.
    shifts : ViewShifts, optional
        How far each view is from where the others predict it; None if that was not measured.

    Raises
    ------
    InputError
        If the radius is not positive.

    Examples
    --------
    >>> field = gm.FieldOfView(case.scanner.geometry(), radius=4.0)
    >>> field.share(np.zeros((1, 3))).tolist()  # all views see the axis
    [1.0]
    """

    geometry: Geometry
    radius: float
    axis: tuple[float, float] = (0.0, 0.0)
    above: bool = False
    below: bool = False
    beside: bool = False
    shifts: ViewShifts | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError("field.radius", f"must be > 0, got {self.radius}", "give it in mm")
        if len(self.geometry) > MAX_FIELD_VIEWS:
            object.__setattr__(self, "geometry", self.geometry[evenly_spaced(len(self.geometry), MAX_FIELD_VIEWS)])

    @property
    def holds_all(self) -> bool:
        """Whether every view saw the whole sample, as far as the radiographs show."""
        return not (self.above or self.below or self.beside)

    def share(self, points: ArrayLike) -> Float:
        """Share of the reference's views that saw each point; 1 beyond a border at which the sample ends.

        Parameters
        ----------
        points : (m, 3) array
            mm, sample frame.

        Returns
        -------
        (m,) array
            Between 0 and 1.
        """
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        if self.holds_all:
            return np.ones(len(points))
        parts = [points[k : k + POINTS_TOGETHER] for k in range(0, len(points), POINTS_TOGETHER)]
        return np.concatenate([self._share(part) for part in parts]) if parts else np.ones(0)

    def border_heights(self, places: ArrayLike, share: float = 0.5) -> tuple[Float, Float]:
        """Lower and upper border of the field above places of the horizontal plane.

        The first and the last row of a panel span, with the source, two planes; a point between them falls on a row
        of the panel.

        Parameters
        ----------
        places : (m, 2) array
            x and y, mm.
        share : float
            Share of the views that see up to the border.

        Returns
        -------
        low, high : (m,) arrays
            z, mm; −∞ and +∞ where the sample does not go on.
        """
        places = np.asarray(places, dtype=float).reshape(-1, 2)
        g, half = self.geometry, self.geometry.shape[0] / 2
        heights = np.empty((2, len(g), len(places)))
        for edge, side in enumerate((-half, half)):
            on_edge = g.detector + side * g.v
            normal = np.cross(g.u, on_edge - g.source if g.beam == "cone" else g.source)
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = -normal[:, :2] / normal[:, 2:]
            flat = places[None] - on_edge[:, None, :2]
            heights[edge] = on_edge[:, 2:] + (slope[:, None] * flat).sum(-1)
        lower, upper = np.sort(heights, axis=0)
        low = np.quantile(lower, share, axis=0) if self.below else np.full(len(places), -np.inf)
        high = np.quantile(upper, 1 - share, axis=0) if self.above else np.full(len(places), np.inf)
        return low, high

    def _share(self, points: Float) -> Float:
        pixels = self.geometry.project_points(points)
        rows, columns = pixels[..., 0], pixels[..., 1]
        height, width = self.geometry.shape
        upright = np.sign(self.geometry.v[:, 2:])  # +1 where row 0 is the lowest
        up = np.where(upright >= 0, rows > height - 0.5, rows < -0.5)
        down = np.where(upright >= 0, rows < -0.5, rows > height - 0.5)
        out = ((columns < -0.5) | (columns > width - 0.5)) & self.beside
        out |= (up & self.above) | (down & self.below) | np.isnan(rows)
        return np.asarray(1 - out.mean(axis=0), dtype=float)


def evenly_spaced(count: int, most: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Indices of ``most`` of ``count`` views, evenly spaced; all of them if they are fewer."""
    return np.unique(np.arange(min(count, most)) * count // max(min(count, most), 1)).astype(np.int64)
