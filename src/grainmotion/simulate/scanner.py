"""A circular scanner whose scans are simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume


@dataclass(frozen=True)
class Scanner:
    """A circular cone-beam scanner and the matching voxel grid.

    Attributes
    ----------
    panel : (int, int)
        Rows and columns.
    pixel_size, source_to_axis, source_to_detector : float
        mm.
    reference_views : int
        Views of the full scan, evenly over 360°.

    Examples
    --------
    >>> case.scanner.panel, case.scanner.voxel_size, len(case.scanner.geometry())
    ((96, 72), 0.125, 90)
    """

    panel: tuple[int, int]
    pixel_size: float
    source_to_axis: float
    source_to_detector: float
    reference_views: int

    @property
    def voxel_size(self) -> float:
        """Size of a pixel projected back to the rotation axis, mm."""
        return self.pixel_size * self.source_to_axis / self.source_to_detector

    def geometry(self, angles_deg: tuple[float, ...] | None = None) -> Geometry:
        """Views of a circular scan.

        Parameters
        ----------
        angles_deg : tuple of float, optional
            Angles of the views, degrees; those of the full scan if None.

        Returns
        -------
        Geometry
            One view an angle.
        """
        if angles_deg is None:
            angles_deg = tuple(np.arange(self.reference_views) * 360.0 / self.reference_views)
        return Geometry.cone(
            angles_deg,
            self.panel,
            self.pixel_size,
            source_to_axis=self.source_to_axis,
            source_to_detector=self.source_to_detector,
        )

    @property
    def grid(self) -> Volume:
        """An empty volume of rows × columns × columns voxels on the axis."""
        rows, columns = self.panel
        return Volume.zeros((rows, columns, columns), self.voxel_size)
