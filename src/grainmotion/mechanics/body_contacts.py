"""Contacts of grains with the bodies beside them: pistons, a container's wall.

As between grains (see `grainmotion.mechanics.contacts`): the gap is the least signed distance of points on the surface
of the grain to that of the body, where its attenuation falls to half, each at its place in the state.  They are a table
of their own, and count neither in fabric tensors nor in coordination numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.mechanics.columns import BODY_CONTACT_COLUMNS, BODY_CONTACTS_CONTENT
from grainmotion.mechanics.contacts import (
    DEFAULT_GAP_TOLERANCE,
    LISTED_GAP,
    PATCH_DEPTH,
    SURFACE_SD,
    check_tolerance,
    gap_kinds,
)
from grainmotion.mechanics.placed_grains import PlacedGrains, placed_grains
from grainmotion.mechanics.surfaces import Surface, SurfaceCache, surface_of
from grainmotion.model.described_table import described
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scene import Body
from grainmotion.model.state_fit import BodyMotion
from grainmotion.model.summary import Summarised
from grainmotion.rotations import skew_matrix

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class BodyContacts(Summarised):
    """Grains that touch or nearly touch a body beside them, in one state.

    Attributes
    ----------
    labels : (m,) int array
        Of the grains.
    bodies : (m,) array of str
        Names of the bodies, as in the scene of the grains.
    gaps, gap_sds : (m,) arrays
        Distance of their surfaces, mm, negative if they overlap, and its standard deviation.
    kinds : (m,) array of str
        As of `Contacts`.
    points, normals : (m, 3) arrays
        Place of the contact, mm, and unit normal from the grain to the body, in this state.
    tolerance : float
        Gap of the decision, mm.

    Examples
    --------
    >>> near = gm.body_contacts(grains, motions)
    >>> near.bodies.tolist()  # this sample has no piston and no wall
    []
    """

    labels: NDArray[np.int64]
    bodies: NDArray[np.str_]
    gaps: Float
    gap_sds: Float
    kinds: NDArray[np.str_]
    points: Float
    normals: Float
    tolerance: float

    def __len__(self) -> int:
        return len(self.labels)

    def to_dataframe(self) -> pd.DataFrame:
        """One row a grain and body: label, body, kind, gap, place and normal, mm.

        Returns
        -------
        DataFrame
            Its ``attrs`` tell units and meanings of the columns, frame, version and tolerance (mm).
        """
        import pandas as pd  # takes half a second

        columns: dict[str, object] = {"label": self.labels, "body": self.bodies, "kind": self.kinds}
        columns |= {"gap": self.gaps, "sd_gap": self.gap_sds}
        for name, vectors in (("", self.points), ("n", self.normals)):
            columns |= {f"{name}{axis}": c for axis, c in zip("xyz", vectors.T, strict=True)}
        return described(pd.DataFrame(columns), BODY_CONTACT_COLUMNS, BODY_CONTACTS_CONTENT, tolerance=self.tolerance)


@checked_arguments
def body_contacts(
    grains: GrainSet, motions: Motions | None = None, *, tolerance: float = DEFAULT_GAP_TOLERANCE
) -> BodyContacts:
    """Contacts of grains with pistons, walls and other bodies, in a state, or in the reference without motions.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference, with the bodies beside them in their scene.
    motions : Motions, optional
        Of the state, mm and radians.  Bodies that it found no motion of are where they were in the reference.
    tolerance : float
        Gap below which a grain and a body are in contact, in voxels of the reference.

    Returns
    -------
    BodyContacts
        Every grain and body with a gap of up to `LISTED_GAP` voxels above the tolerance; none where there is no body.

    Raises
    ------
    InputError
        If the tolerance is not positive, or ``motions`` names a label that is not among the grains.

    Examples
    --------
    >>> len(gm.body_contacts(grains, motions))  # this sample has no piston and no wall
    0
    """
    check_tolerance("body_contacts.tolerance", tolerance)
    placed, _ = placed_grains(grains, motions)
    h, surfaces = grains.voxel_size, SurfaceCache(grains)
    moved = {} if motions is None else {motion.name: motion for motion in motions.fit.bodies}
    found: list[tuple[int, str, float, float, Float, Float]] = []
    for body in grains.scene.bodies:
        surface = None if body.kind == "rest" else surface_of(Grain(0, body.volume, body.center), h)
        if surface is None:
            continue
        place = _PlacedBody.of(body, moved.get(body.name), surface)
        for k, row in enumerate(placed.rows):
            own = (
                surfaces[int(row)] if place.is_near(placed, k, grains, int(row), h * (tolerance + LISTED_GAP)) else None
            )
            closest = None if own is None else place.closest(placed, k, own, h)
            if closest is not None and closest[0] <= h * (tolerance + LISTED_GAP):
                gap, point, normal = closest
                found.append(
                    (int(grains.labels[row]), body.name, gap, place.sd(placed, k, point, normal), point, normal)
                )
    found.sort(key=lambda row: row[0])
    m = len(found)
    gaps, points, normals = (np.array([row[k] for row in found], dtype=float) for k in (2, 4, 5))
    sds = np.hypot(np.array([row[3] for row in found], dtype=float), SURFACE_SD * h)
    return BodyContacts(
        np.array([row[0] for row in found], dtype=np.int64), np.array([row[1] for row in found], dtype=np.str_), gaps,
        sds, gap_kinds(gaps, sds, tolerance * h, h), points.reshape(m, 3), normals.reshape(m, 3), tolerance * h,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _PlacedBody:
    """A body at its place in a state: x = R (X − c) + u + c."""

    surface: Surface
    matrix: Float
    translation: Float
    center: Float
    covariance: Float

    @classmethod
    def of(cls, body: Body, motion: BodyMotion | None, surface: Surface) -> _PlacedBody:
        if motion is None:
            return cls(surface, np.eye(3), np.zeros(3), body.center, np.zeros((6, 6)))
        return cls(surface, motion.matrix, motion.translation, motion.center, np.nan_to_num(motion.covariance))

    def to_reference(self, points: Float) -> Float:
        return (points - self.translation - self.center) @ self.matrix + self.center

    def is_near(self, placed: PlacedGrains, k: int, grains: GrainSet, row: int, reach: float) -> bool:
        """Whether the box of a grain may come within ``reach`` of the body, mm."""
        volume = grains.grains[row].volume
        half = np.linalg.norm(volume.voxel_size * np.array(volume.shape)) / 2
        middle = self.to_reference(placed.to_state(k, np.array([volume.center])))
        return bool(np.asarray(self.surface.tree.query(middle)[0])[0] < half + reach)

    def closest(
        self, placed: PlacedGrains, k: int, own: Surface, voxel_size: float
    ) -> tuple[float, Float, Float] | None:
        """Gap, place and normal towards the body; None if it is farther than the grain is wide."""
        places = placed.to_state(k, own.points)
        heights, index = self.surface.distances(self.to_reference(places), 2 * own.radius)
        if not np.isfinite(heights).any():
            return None
        gap = float(heights.min())
        patch = heights <= gap + PATCH_DEPTH * voxel_size
        outward = placed.gradients[k] @ own.normals[patch].mean(axis=0)
        normal = outward - self.matrix @ self.surface.normals[index[patch]].mean(axis=0)
        length = float(np.linalg.norm(normal))
        if length == 0:
            return None
        normal /= length
        return gap, places[patch].mean(axis=0) + heights[patch].mean() / 2 * normal, normal

    def sd(self, placed: PlacedGrains, k: int, point: Float, normal: Float) -> float:
        """Standard deviation of the gap by the motions of both, mm; infinite where that of the grain is not known."""
        of_grain = placed.lever(k, point, normal)
        of_body = np.concatenate([normal, -skew_matrix(point - self.center - self.translation).T @ normal])
        variance = float(of_grain @ placed.covariances[k] @ of_grain + of_body @ self.covariance @ of_body)
        return float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else float("inf")
