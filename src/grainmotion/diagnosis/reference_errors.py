"""What the reference scan shows of its own errors: notes on a state, and standard deviations that hold them.

A sample that moved during the scan, and a panel that is out of place, leave residuals in the reference scan and next to
none in the few views of a later state, where they move all grains alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float
from grainmotion.diagnosis.directions import missing_directions
from grainmotion.diagnosis.moving_sample import displaced_volume, likely_motions, motion_findings
from grainmotion.diagnosis.panel_offset import PanelOffset
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.geometry import Geometry

WHERE = "reference"
ERROR_BY_CREEP = 0.02
"""Error that all translations have in common, over the motion of the sample during the reference scan: 0.007 to 0.024
along each axis where it sank steadily by a voxel (two samples, 4 and 2 views).  Motions along x and y displace the
volume as well (`displaced_volume`)."""


@dataclass(frozen=True, eq=False)
class ReferenceErrors:
    """Covariances ``(n, 6, 6)`` of (u, δ), mm and radians, to be added to the grains' own, and sentences."""

    covariances: Float
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, field: FieldOfView | None, geometry: Geometry, places: Float) -> ReferenceErrors:
        """What the reference scan of ``field`` means for grains at ``places (n, 3)`` in a state of this geometry."""
        covariances, notes = np.zeros((len(places), 6, 6)), list[str]()
        if field is None or field.shifts is None or missing_directions(field.geometry, WHERE):
            return cls(covariances)
        panel, moved = PanelOffset.of(field), likely_motions(field.shifts)
        if moved:
            notes += [str(finding) for finding in motion_findings(field.shifts, WHERE)]
            covariances[:, :3, :3] += (ERROR_BY_CREEP * moved[0].size * field.shifts.pixel) ** 2 * np.eye(3)
            for motion in moved:
                place = displaced_volume(field.shifts, motion) * field.shifts.pixel
                covariances[:, :2, :2] += np.outer(place, place)
        if panel:
            notes.append(panel.note)
            covariances += panel.covariances(geometry, places)
        return cls(covariances, tuple(notes))
