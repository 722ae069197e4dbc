"""The circle of source and panel, found in whole positions of each view: to override numbers, or for later images."""

from __future__ import annotations

import numpy as np

from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers
from grainmotion.io.scanners.rigid_setup import RigidSetup, circle_numbers
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry

MAX_DEPARTURE = 0.5
"""Pixels by which projections of points of the sample may depart from those of the circle."""
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]])
"""Points of the sample, in units of a quarter of the panel's width at the axis."""


def circle_of_views(views: Geometry) -> CircleNumbers | None:
    """The numbers of a circular cone-beam scan with its angles; None if the views are not on one circle about z."""
    source, center, u, v = views.source[0], views.detector[0], views.u[0], views.v[0]
    pitch = float(views.pixel_sizes.mean())
    directions = (u / np.linalg.norm(u), v / np.linalg.norm(v))
    try:
        setup = RigidSetup(source, center, *directions, np.array([0.0, 0.0, 1.0]))
        numbers, mirrored = circle_numbers("views", setup)
        panel = DetectorAlignment(
            detector_offset=numbers["detector_offset"],
            detector_tilts_deg=numbers["detector_tilts_deg"],
            axis_offset=numbers["axis_offset"],
            first_row=numbers["first_row"],
        )
        to_axis, to_panel = numbers["source_to_axis"], numbers["source_to_detector"]
        at_zero = Geometry.cone(
            [0.0], views.shape, pitch, source_to_axis=to_axis, source_to_detector=to_panel, panel=panel
        )
        angles = views.azimuths_deg - at_zero.azimuths_deg
        circle = Geometry.cone(
            angles, views.shape, pitch, source_to_axis=to_axis, source_to_detector=to_panel, panel=panel
        )
    except InputError:
        return None
    points = POINTS * views.pixel_at((0, 0, 0)) * views.shape[1] / 4
    departure = np.abs(circle.project_points(points) - views.project_points(points)).max()
    if mirrored or not departure <= MAX_DEPARTURE:
        return None
    return CircleNumbers(beam="cone", pixel_size=pitch, angles_deg=angles, **numbers)
