"""Geometry: one 12-vector a view, as ASTRA's ``cone_vec`` and ``parallel3d_vec``.

A view holds, in the sample frame (x y z, mm), the source position (cone beam) or the direction in
which the rays travel (parallel beam), the centre of the panel, the step ``u`` from column 0 to
column 1 and the step ``v`` from row 0 to row 1.  Pixel (row r, column c) of a panel of R × C pixels
is centred at  d + (c − (C − 1)/2) u + (r − (R − 1)/2) v.

Circular scans from above (z towards the reader), at θ = 0 and after a rotation by θ::

        y                                 source and panel turn counter-clockwise by θ about z in the
        |   panel (u along +x)            sample frame, which is the sample on its stage turning
      --+-----------> u                   clockwise: a grain on the +x side at θ = 0 shows at columns
        |                                 right of the centre, and comes nearer to the source as θ
        o----- x   (rotation axis)        grows from 0.
        |
        S  source at y = −source_to_axis; the beam runs along +y

Row 0 is the lowest row (v along +z, as in ASTRA) unless ``first_row = "top"``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from grainmotion._arguments import check_argument, checked_arguments
from grainmotion._typing import Beam, Float
from grainmotion.errors import InputError
from grainmotion.model.astra_geometry import ASTRA_TYPES, AstraGeometry, astra_geometry, views_of_astra
from grainmotion.model.detector_alignment import AlignmentKeys, DetectorAlignment, circular_views, panel_of
from grainmotion.model.geometry_summary import views_summary
from grainmotion.model.panel_projection import project_onto_panels
from grainmotion.model.summary import Summarised, Summary
from grainmotion.model.view_checks import VIEW_COLUMNS, check_views


@dataclass(frozen=True, eq=False, repr=False)
class Geometry(Summarised):
    """The views of a scan.

    Attributes
    ----------
    vectors : (n, 12) float array
        Source (or ray direction), panel centre, u and v of each view, mm, sample frame.
    shape : (int, int)
        Rows and columns of the panel.
    beam : {"cone", "parallel"}
        Whether the first three numbers are the source's position or the rays' direction.

    Raises
    ------
    InputError
        If a row holds NaN, u or v is zero or they are parallel, rays lie in the panel's plane, or
        the source lies in the panel's plane.

    Examples
    --------
    >>> views = gm.Geometry.cone((0, 90), (96, 72), 0.5, source_to_axis=120, source_to_detector=480)
    >>> len(views), views.shape
    (2, (96, 72))
    >>> views.source[0].tolist()  # at θ = 0 the beam goes along +y
    [0.0, -120.0, 0.0]
    """

    vectors: Float
    shape: tuple[int, int]
    beam: Beam = "cone"

    def __post_init__(self) -> None:
        vectors = np.array(self.vectors, dtype=float, order="C", ndmin=2)  # a table's columns are in the other order
        if vectors.ndim != 2 or vectors.shape[1] != 12 or len(vectors) == 0:
            raise InputError("geometry", f"shape {vectors.shape} is not (views, 12)", f"give {','.join(VIEW_COLUMNS)}")
        if self.beam not in ASTRA_TYPES:
            raise InputError("beam", f"'{self.beam}' is unknown", 'use "cone" or "parallel"')
        check_argument("Geometry(shape)", self.shape, ["tuple[int, int]"])
        rows, columns = (int(n) for n in self.shape)
        if rows < 1 or columns < 1:
            raise InputError("geometry", f"a panel of {self.shape} pixels", "give rows and columns >= 1")
        check_views(vectors, self.beam)
        vectors.setflags(write=False)
        object.__setattr__(self, "vectors", vectors)
        object.__setattr__(self, "shape", (rows, columns))

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self.vectors.setflags(write=False)  # which pickling forgets: kernels are compiled once for both

    @classmethod
    @checked_arguments
    def cone(
        cls,
        angles_deg: ArrayLike,
        shape: tuple[int, int],
        pixel_size: float,
        *,
        source_to_axis: float,
        source_to_detector: float,
        panel: DetectorAlignment | None = None,
        **alignment: Unpack[AlignmentKeys],
    ) -> Geometry:
        """A circular cone-beam scan.

        Parameters
        ----------
        angles_deg : (n,) array
            Angle of each view, degrees; see the drawing in `grainmotion.model.geometry`.
        shape : (int, int)
            Rows and columns of the panel.
        pixel_size : float
            Edge of a pixel, mm.
        source_to_axis, source_to_detector : float
            Distances from the source to the rotation axis and to the panel, mm.
        panel : DetectorAlignment, optional
            Departures from a perfect set-up.
        **alignment : float or str
            Or these departures by themselves, as keys of the experiment file: ``first_row`` ("bottom" or "top", where
            row 0 lies), ``detector_offset``, ``detector_tilts_deg``, ``axis_offset``, ``axis_tilt_deg``; their meaning
            is that of the fields of `DetectorAlignment`.

        Returns
        -------
        Geometry
            One view an angle.

        Raises
        ------
        InputError
            If the axis does not lie between source and detector, a number is not finite, or a keyword is unknown.
        """
        panel = panel_of("Geometry.cone", panel, alignment)
        if not 0 < source_to_axis < source_to_detector:
            raise InputError(
                "geometry.source_to_axis",
                f"{source_to_axis} mm is not between 0 and source_to_detector = {source_to_detector} mm",
                "give both distances from the source, in mm",
            )
        start = np.array([0.0, -source_to_axis, 0.0])
        center = np.array([0.0, source_to_detector - source_to_axis, 0.0])
        return cls(circular_views(start, center, angles_deg, pixel_size, panel, cone=True), shape, "cone")

    @classmethod
    @checked_arguments
    def parallel(
        cls,
        angles_deg: ArrayLike,
        shape: tuple[int, int],
        pixel_size: float,
        *,
        panel: DetectorAlignment | None = None,
        **alignment: Unpack[AlignmentKeys],
    ) -> Geometry:
        """A circular parallel-beam scan; the panel's centre lies on the axis, as its distance does not matter.

        Parameters
        ----------
        angles_deg : (n,) array
            Angle of each view, degrees; see the drawing in `grainmotion.model.geometry`.
        shape : (int, int)
            Rows and columns of the panel.
        pixel_size : float
            Edge of a pixel, mm.
        panel : DetectorAlignment, optional
            Departures from a perfect set-up.
        **alignment : float or str
            Or these departures by themselves, as keys of the experiment file: ``first_row`` ("bottom" or "top", where
            row 0 lies), ``detector_offset``, ``detector_tilts_deg``, ``axis_offset``, ``axis_tilt_deg``; their meaning
            is that of the fields of `DetectorAlignment`.

        Returns
        -------
        Geometry
            One view an angle.

        Raises
        ------
        InputError
            If a number is not finite, or a keyword is unknown.
        """
        panel = panel_of("Geometry.parallel", panel, alignment)
        start = np.array([0.0, 1.0, 0.0])
        return cls(circular_views(start, np.zeros(3), angles_deg, pixel_size, panel, cone=False), shape, "parallel")

    def __len__(self) -> int:
        return len(self.vectors)

    def __getitem__(self, views: int | slice | Sequence[int] | NDArray[np.integer] | NDArray[np.bool_]) -> Geometry:
        """The geometry of the selected views, in the given order."""
        index = [int(views)] if isinstance(views, int | np.integer) else views
        return Geometry(self.vectors[index], self.shape, self.beam)

    @property
    def source(self) -> Float:
        """Position of the source (mm), or direction of the rays of a parallel beam, ``(n, 3)``."""
        return self.vectors[:, :3]

    @property
    def detector(self) -> Float:
        """Centres of the panels, ``(n, 3)``, mm."""
        return self.vectors[:, 3:6]

    @property
    def u(self) -> Float:
        """Steps from column 0 to column 1, ``(n, 3)``, mm."""
        return self.vectors[:, 6:9]

    @property
    def v(self) -> Float:
        """Steps from row 0 to row 1, ``(n, 3)``, mm."""
        return self.vectors[:, 9:]

    @property
    def rays(self) -> Float:
        """Central rays ``(n, 3)``: from the source to the panel's centre (mm), or the direction of a parallel beam."""
        return self.detector - self.source if self.beam == "cone" else self.source

    @property
    def normals(self) -> Float:
        """u × v of each panel, ``(n, 3)``, mm²."""
        return np.cross(self.u, self.v)

    @property
    def azimuths_deg(self) -> Float:
        """Angle of each view about z, degrees in [0, 360): 0 where the beam runs along +y, counter-clockwise."""
        angles = np.rad2deg(np.arctan2(-self.rays[:, 0], self.rays[:, 1]))
        return np.asarray(np.round(angles, 6) % 360, dtype=float)

    @property
    def pixel_sizes(self) -> Float:
        """Lengths of v and u (row, column step) of each view, ``(n, 2)``, mm."""
        return np.stack([np.linalg.norm(self.v, axis=1), np.linalg.norm(self.u, axis=1)], axis=1)

    def pixel_positions(self, view: int) -> Float:
        """Centres of all pixels of one view.

        Parameters
        ----------
        view : int
            Index of the view.

        Returns
        -------
        (rows, columns, 3) array
            mm, sample frame.
        """
        r = np.arange(self.shape[0]) - (self.shape[0] - 1) / 2
        c = np.arange(self.shape[1]) - (self.shape[1] - 1) / 2
        return self.detector[view] + c[None, :, None] * self.u[view] + r[:, None, None] * self.v[view]

    def project_points(self, points: ArrayLike) -> Float:
        """Project points onto the panel of every view.

        Parameters
        ----------
        points : (m, 3) array
            mm, sample frame.

        Returns
        -------
        (n, m, 2) array
            Row and column, pixels; NaN for a point behind the source.
        """
        return project_onto_panels(self.vectors, self.shape, self.beam, points)

    def pixel_at(self, point: ArrayLike) -> float:
        """Size of a pixel at a point of the sample: pixel size over magnification.

        Parameters
        ----------
        point : (3,) array
            mm, sample frame.

        Returns
        -------
        float
            mm, mean over the views.
        """
        size = self.pixel_sizes.mean(axis=1)
        if self.beam == "parallel":
            return float(size.mean())
        normals, ray = self.normals, np.asarray(point, dtype=float) - self.source
        depth = (ray * normals).sum(1) / (self.rays * normals).sum(1)
        return float((size * depth).mean())

    def window(self, first: tuple[int, int] | NDArray[np.integer], shape: tuple[int, int]) -> Geometry:
        """The same views on another part of the panels' planes.

        Parameters
        ----------
        first : (int, int) or (views, 2) int array
            Row and column of its first pixel on this panel, of all views or of each; may be negative.
        shape : (int, int)
            Rows and columns of the window, which may be larger than the panel.

        Returns
        -------
        Geometry
            Views of ``shape`` pixels.
        """
        middle = np.atleast_2d(first) + (np.array(shape) - self.shape) / 2
        vectors = self.vectors.copy()
        vectors[:, 3:6] += middle[:, 1:] * self.u + middle[:, :1] * self.v
        return Geometry(vectors, shape, self.beam)

    def binned(self, factor: int) -> Geometry:
        """The same panels with larger pixels.

        Parameters
        ----------
        factor : int
            Edge of the new pixels over that of the old ones.

        Returns
        -------
        Geometry
            Views of fewer pixels.

        Raises
        ------
        InputError
            If rows or columns do not divide by ``factor``.
        """
        rows, columns = self.shape
        if rows % factor or columns % factor:
            raise InputError("geometry", f"{self.shape} pixels do not divide by {factor}", "take a window first")
        vectors = self.vectors.copy()
        vectors[:, 6:12] *= factor
        return Geometry(vectors, (rows // factor, columns // factor), self.beam)

    def to_astra(self) -> AstraGeometry:
        """The projection geometry that ``astra.create_proj_geom`` makes of these views (copied)."""
        return astra_geometry(self.vectors, self.shape, self.beam)

    @classmethod
    def from_astra(cls, geometry: AstraGeometry) -> Geometry:
        """Read a geometry of ASTRA.

        Parameters
        ----------
        geometry : dict
            A ``cone_vec`` or ``parallel3d_vec`` geometry; `astra.geom_2vec` makes one of a circular scan.

        Returns
        -------
        Geometry
            The same views.

        Raises
        ------
        InputError
            If it is of another type.
        """
        return cls(*views_of_astra(geometry))

    def _summary(self) -> Summary:
        return views_summary(self.vectors, self.shape, self.beam, self.azimuths_deg)
