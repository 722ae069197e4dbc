"""A scanner as it stands in the laboratory, with an asymmetric object of balls: images that no projector of ours made.

Seen from the source, which looks along +y: x points to the right, z up.  The image is what a viewer shows who stands
at the source: row 0 at the top, column 0 at the left.  The stage turns the object counter-clockwise seen from above by
``angle_deg``.  Line integrals through balls are their chord lengths times the attenuation, in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BALLS = (  # x, y, z, radius (mm), attenuation (1/mm): no symmetry, and no two alike
    (2.1, 0.4, 1.3, 0.9, 0.30),
    (-0.8, 1.9, -0.6, 0.7, 0.45),
    (-1.2, -1.4, 1.1, 0.5, 0.60),
    (0.5, -0.9, -1.7, 0.6, 0.25),
)


@dataclass(frozen=True)
class Lab:
    """Source, stage and panel; lengths in mm."""

    source_to_axis: float = 60.0
    source_to_panel: float = 240.0
    pixel: float = 0.4
    shape: tuple[int, int] = (56, 64)  # rows, columns
    panel_shift: tuple[float, float] = (0.0, 0.0)  # of the panel's centre to the right and up
    axis_shift: float = 0.0  # of the rotation axis to the right
    panel_roll_deg: float = 0.0  # of the panel, clockwise as the source sees it
    parallel: bool = False

    def image(self, angle_deg: float, balls=BALLS) -> np.ndarray:
        """Line integrals ``(rows, columns)`` with the stage turned counter-clockwise by ``angle_deg``."""
        a, roll = np.deg2rad(angle_deg), np.deg2rad(self.panel_roll_deg)
        rows, columns = self.shape
        right = (np.arange(columns) - (columns - 1) / 2) * self.pixel
        up = -(np.arange(rows) - (rows - 1) / 2) * self.pixel
        right, up = np.meshgrid(right, up)
        across = np.cos(roll) * right + np.sin(roll) * up + self.panel_shift[0]
        above = -np.sin(roll) * right + np.cos(roll) * up + self.panel_shift[1]
        depth = self.source_to_panel - self.source_to_axis
        pixels = np.stack([across, np.full_like(across, depth), above], axis=-1)
        if self.parallel:
            start, rays = pixels, np.broadcast_to([0.0, 1.0, 0.0], pixels.shape)
        else:
            start = np.broadcast_to([0.0, -self.source_to_axis, 0.0], pixels.shape)
            rays = pixels - start
            rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        total = np.zeros(self.shape)
        for x, y, z, radius, attenuation in balls:
            center = np.array([np.cos(a) * x - np.sin(a) * y + self.axis_shift, np.sin(a) * x + np.cos(a) * y, z])
            away = center - start
            along = (away * rays).sum(axis=-1)
            square = radius**2 - ((away**2).sum(axis=-1) - along**2)
            total += attenuation * 2 * np.sqrt(np.maximum(square, 0))
        return total

    def images(self, angles_deg) -> np.ndarray:
        """Line integrals ``(views, rows, columns)``."""
        return np.stack([self.image(a) for a in angles_deg])


def seen_centers(images: np.ndarray) -> np.ndarray:
    """Row and column of the centre of mass of each image, ``(views, 2)``."""
    rows, columns = np.indices(images.shape[1:])
    mass = images.sum(axis=(1, 2))
    return np.stack([(images * rows).sum(axis=(1, 2)) / mass, (images * columns).sum(axis=(1, 2)) / mass], axis=1)


def ball_images(geometry, balls=BALLS) -> np.ndarray:
    """The images that a `grainmotion.Geometry` says this object gives, where the object is at rest at its angle 0."""
    images = []
    for view in range(len(geometry)):
        pixels = geometry.pixel_positions(view)
        if geometry.beam == "cone":
            start = np.broadcast_to(geometry.source[view], pixels.shape)
            rays = pixels - start
        else:
            start, rays = pixels, np.broadcast_to(geometry.source[view], pixels.shape)
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        total = np.zeros(pixels.shape[:2])
        for x, y, z, radius, attenuation in balls:
            away = np.array([x, y, z]) - start
            along = (away * rays).sum(axis=-1)
            total += attenuation * 2 * np.sqrt(np.maximum(radius**2 - ((away**2).sum(axis=-1) - along**2), 0))
        images.append(total)
    return np.stack(images)
