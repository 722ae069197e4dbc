"""A panel that is out of place in the reference scan, and what that can do to the motions of a later state.

A panel that lies beside its given place by s along u, or is turned in its plane, moves the image of every view alike.
Views from all around contradict each other then, so that the reference scan shows it (`reconstruction.view_shifts`).
The few views of a later state do not: two views at right angles agree with a sample that moved by √2 s.  Whether the
panel is out of place in the state as well is not known, so standard deviations hold the motion that this would imitate.
An offset along v moves reference and state alike, and is no motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry
from grainmotion.model.view_shifts import ViewShifts

SIGNIFICANT_OFFSET = 8.0
"""Standard errors from which an offset is told."""
MIN_OFFSET_PIXELS = 0.05
"""Pixels, at the middle or at the edge of the panel, from which an offset is told: 0.00 to 0.02 where the panel is in
its place, 0.57 where it is off by half a pixel."""
STEP_MM = 1e-3
"""Displacement by which projections are differentiated, mm."""


@dataclass(frozen=True)
class PanelOffset:
    """How far the panel is from its place in the reference scan.

    ``shift`` is along u, pixels, ``turn`` in the panel's plane, radians, as of `ViewShifts.turns`.
    """

    shift: float = 0.0
    turn: float = 0.0

    def __bool__(self) -> bool:
        return self.shift != 0 or self.turn != 0

    @classmethod
    def of(cls, field: FieldOfView | None) -> PanelOffset:
        """What the reference scan shows; nothing if its views were not compared, or are in their places."""
        shifts = None if field is None else field.shifts
        if shifts is None:
            return cls()
        shift, of_shift = _common(shifts.values[:, 0], shifts)
        turn, of_turn = _common(shifts.turns, shifts)
        clear_shift = abs(shift) > max(MIN_OFFSET_PIXELS, SIGNIFICANT_OFFSET * of_shift)
        clear_turn = abs(turn) > max(MIN_OFFSET_PIXELS / shifts.half_width, SIGNIFICANT_OFFSET * of_turn)
        return cls(shift if clear_shift else 0.0, turn if clear_turn else 0.0)

    @property
    def note(self) -> str:
        """The sentence for the user."""
        return (
            f"reference: its views contradict each other as if the panel were out of place by {abs(self.shift):.2f} "
            f"pixel along u and turned by {np.rad2deg(abs(self.turn)):.2f} degree in its plane; standard deviations "
            "hold the motion that the same offset imitates in this state; correct the geometry of all scans by "
            "`calibrate` (calibrate.geometry in an experiment file)"
        )

    def motions(self, geometry: Geometry, places: Float) -> Float:
        """Motions (u, δ) that the same offset imitates in a state, ``(n, 6)``, mm and radians.

        Parameters
        ----------
        geometry : Geometry
            Views of the state, as given.
        places : (n, 3) array
            Centres of the grains in the state, mm.
        """
        n, step = len(places), STEP_MM * np.eye(3)
        pixels = geometry.project_points(places)
        moved = geometry.project_points((places[:, None] + step).reshape(-1, 3)).reshape(len(geometry), n, 3, 2)
        derivatives = np.swapaxes(moved - pixels[:, :, None], 2, 3) / STEP_MM  # (views, n, 2, 3)
        rows, columns = np.moveaxis(pixels - (np.array(geometry.shape) - 1) / 2, -1, 0)
        asked = np.stack([-self.turn * columns, self.shift + self.turn * rows], axis=-1)
        seen = np.isfinite(asked).all(axis=-1) & np.isfinite(derivatives).all(axis=(-1, -2))
        asked, derivatives = np.where(seen[..., None], asked, 0), np.where(seen[..., None, None], derivatives, 0)
        system = np.moveaxis(derivatives, 1, 0).reshape(n, -1, 3)
        right = np.moveaxis(asked, 1, 0).reshape(n, -1, 1)
        translations = (np.linalg.pinv(system, 1e-3) @ right)[..., 0]
        lines = np.cross(geometry.u, geometry.v)
        lines /= np.linalg.norm(lines, axis=1, keepdims=True)
        rotation = np.linalg.pinv(lines, 1e-2) @ np.full(len(lines), -self.turn)
        return np.hstack([translations, np.broadcast_to(rotation, (n, 3))])

    def covariances(self, geometry: Geometry, places: Float) -> Float:
        """Covariances ``(n, 6, 6)`` of (u, δ), mm and radians, by such a motion; parameters as of `motions`."""
        motions = self.motions(geometry, places)
        return motions[:, :, None] * motions[:, None, :]


def _common(values: Float, shifts: ViewShifts) -> tuple[float, float]:
    """What all views have in common beside a sample that is off its place and moves, and its standard error."""
    columns = np.column_stack([np.ones_like(values), shifts.along, shifts.times[:, None] * shifts.along])
    inverse = np.linalg.pinv(columns)
    rest = values - columns @ (inverse @ values)
    variance = float(rest @ rest) / max(len(values) - columns.shape[1], 1)
    return float(inverse[0] @ values), float(np.sqrt(variance * (inverse[0] @ inverse[0])))
