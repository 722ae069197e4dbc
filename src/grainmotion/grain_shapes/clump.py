"""A clump: spheres that fill a grain, chosen one after the other.

Each sphere touches the surface from inside.  Its centre is a point of the medial axis on a grid: one whose sphere is
not held by that of a neighbour.  The first is the largest; each next one is that which fills most of what is still
empty (a greedy cover, whose share of the best possible cover with as many spheres is at least 1 − 1/e; Nemhauser,
Wolsey and Fisher, Math. Programming 14, 1978).  What a sphere adds only falls as others are added, so that few must be
counted again at each step.  At last each centre moves by less than a step of the grid to where its sphere is largest.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from grainmotion._arguments import checked_arguments, renamed_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.grain_shapes.level_set import LONGEST_EDGE, LevelSet, level_set
from grainmotion.grain_shapes.mass_properties import MassProperties, mass_properties
from grainmotion.grain_shapes.triangle_mesh import Surface, subdivided
from grainmotion.model.summary import Summarised

HELD_SLOPE = 0.8
"""Rise of the depth towards a neighbour, over its distance, from which the neighbour's sphere holds that of a point."""
SMALLEST_SPHERE = 1.0
"""Radius of the smallest sphere, over the spacing of the grid."""
MIN_SPHERE_GAIN = 5e-4
"""Share of the grain's volume that a sphere must fill: spheres that add less are steps of the grid."""
FILLED_BEYOND = 0.5
"""Distance beyond a sphere up to which space counts as filled, over the spacing: no spheres for thinner crescents."""
REFINING_STEPS = (0.5, 0.25, 0.125)
"""Steps by which centres move to where their sphere is largest, over the spacing."""
CHORDS = 160
"""Lines across a clump, along x and along y, on which its mass properties are integrated."""

ClumpFit = Literal["inside", "volume"]


@dataclass(frozen=True, eq=False, repr=False)
class Clump(Summarised):
    """Overlapping spheres in place of a grain.

    Attributes
    ----------
    centers : (k, 3) array
        mm, x y z, in the frame of the surface; the largest sphere first.
    radii : (k,) array
        mm.
    properties : MassProperties
        Of the union of the spheres at density 1, where they overlap counted once.
    grain : MassProperties
        Of the grain.

    Examples
    --------
    >>> spheres = gm.clump(gm.grain_surface(grains.grains[0]), 0.1, spheres=10)
    >>> len(spheres.centers) == len(spheres.radii) <= 10
    True
    """

    centers: Float
    radii: Float
    properties: MassProperties
    grain: MassProperties

    def __len__(self) -> int:
        return len(self.radii)

    @property
    def volume_error(self) -> float:
        """Volume of the union over that of the grain, minus 1; negative where spheres leave gaps."""
        return self.properties.volume / self.grain.volume - 1

    @property
    def density_scale(self) -> float:
        """Density for the union, over that of the grain, at which the clump has the grain's mass."""
        return self.grain.volume / self.properties.volume

    @property
    def density_scale_of_sum(self) -> float:
        """The same for codes that add up the masses of all spheres, as if they did not overlap."""
        return float(self.grain.volume / (4 / 3 * np.pi * (self.radii**3).sum()))


@renamed_arguments(fit="clump_fit")
@checked_arguments
def clump(
    surface: Surface,
    spacing: float,
    *,
    spheres: int = 20,
    max_volume_error: float = 0.0,
    clump_fit: ClumpFit = "volume",
) -> Clump:
    """Fill a grain with overlapping spheres.

    Parameters
    ----------
    surface : Surface
        Closed, facing outwards, mm.
    spacing : float
        Of the grid on which centres lie, mm; the voxel size as a rule.
    spheres : int
        Largest number of spheres.
    max_volume_error : float
        Stop earlier where the empty share of the volume is less than this.
    clump_fit : {"inside", "volume"}
        Spheres that touch the surface from inside, or all radii enlarged by the same length until the union has the
        volume of the grain.

    Returns
    -------
    Clump
        The spheres, to the accuracy of the grid.

    Raises
    ------
    InputError
        If a number is not positive, or the grain is too small for a sphere.

    Examples
    --------
    >>> surface = gm.grain_surface(grains.grains[0])
    >>> spheres = gm.clump(surface, 0.1, spheres=10)
    >>> bool(abs(spheres.volume_error) < 0.1)
    True
    """
    if spheres < 1:
        raise InputError("clump.spheres", f"must be at least 1, got {spheres}", "give 5 to 100")
    if not 0 <= max_volume_error < 1:
        raise InputError("clump.max_volume_error", f"must be 0 to 1, got {max_volume_error}", "give 0.05, say")
    if clump_fit not in get_args(ClumpFit):
        raise InputError("clump.clump_fit", f"unknown fit '{clump_fit}'", "give 'inside' or 'volume'")
    return clump_of(surface, level_set(surface, spacing, margin=2), spheres, max_volume_error, clump_fit)


def clump_of(surface: Surface, field: LevelSet, spheres: int, max_volume_error: float, fit: ClumpFit) -> Clump:
    """As `clump`, of a grain whose level set is known."""
    grain = mass_properties(surface)
    centers, radii = _refined(surface, _chosen(field, spheres, max_volume_error), field.spacing)
    if fit == "volume":
        radii = radii + _swelling(centers, radii, grain.volume)
    return Clump(centers, radii, union_properties(centers, radii), grain)


def _refined(surface: Surface, centers: Float, spacing: float) -> tuple[Float, Float]:
    """Centres moved to where their sphere is largest nearby, and the radii."""
    tree = cKDTree(subdivided(surface, LONGEST_EDGE * spacing).vertices)
    radii = np.array(tree.query(centers)[0], dtype=float)
    around = np.vstack([np.eye(3), -np.eye(3)])
    for step in REFINING_STEPS:
        places = centers[:, None] + step * spacing * around
        reached = np.array(tree.query(places)[0], dtype=float)
        best = reached.argmax(axis=1)
        rows = np.arange(len(centers))
        better = reached[rows, best] > radii
        centers = np.where(better[:, None], places[rows, best], centers)
        radii = np.maximum(radii, reached[rows, best])
    return centers, radii


def _chosen(field: LevelSet, spheres: int, max_volume_error: float) -> Float:
    """Centres of the spheres ``(k, 3)``, mm, on the grid."""
    depth = -field.values / field.spacing
    places = np.argwhere(_medial(depth))
    if not len(places):
        raise InputError("clump", "no sphere as large as the grid's spacing fits in", "give a smaller spacing")
    radii = depth[tuple(places.T)]
    empty = depth > 0
    bare, whole = empty.copy(), np.count_nonzero(empty)  # bare: in no sphere, crescents included
    # (−what it adds, counted when so many spheres were chosen, candidate); before counting, the volume is the bound
    queue = [(-4 / 3 * np.pi * (r + 1) ** 3, -1, k) for k, r in enumerate(radii)]
    queue[int(radii.argmax())] = (-np.inf, 0, int(radii.argmax()))
    heapq.heapify(queue)
    chosen: list[int] = []
    while queue and len(chosen) < spheres and np.count_nonzero(bare) > max_volume_error * whole:
        gain, counted, k = heapq.heappop(queue)
        box, within = _ball(empty.shape, places[k], radii[k])
        if counted == len(chosen):
            if chosen and -gain < MIN_SPHERE_GAIN * whole:
                break
            bare[box][within] = False
            box, within = _ball(empty.shape, places[k], radii[k] + FILLED_BEYOND)
            empty[box][within] = False
            chosen.append(k)
        else:
            heapq.heappush(queue, (-int(np.count_nonzero(empty[box] & within)), len(chosen), k))
    return field.origin + field.spacing * places[chosen][:, ::-1]


def _swelling(centers: Float, radii: Float, volume: float) -> float:
    """Length by which all radii grow until the union has a volume, mm."""

    def missing(length: float) -> float:
        return union_properties(centers, radii + length, CHORDS // 2).volume - volume

    reach = float(radii.max())
    return float(brentq(missing, 0, reach, xtol=1e-4 * reach)) if missing(0) < 0 < missing(reach) else 0.0


def _medial(depth: Float) -> NDArray[np.bool_]:
    """Points whose sphere no neighbour's sphere holds."""
    padded = np.pad(depth, 1, constant_values=-np.inf)
    nz, ny, nx = depth.shape
    keep = depth >= SMALLEST_SPHERE
    for dz, dy, dx in np.ndindex(3, 3, 3):
        step = float(np.sqrt((dz - 1) ** 2 + (dy - 1) ** 2 + (dx - 1) ** 2))
        if step:
            keep &= padded[dz : dz + nz, dy : dy + ny, dx : dx + nx] - depth < HELD_SLOPE * step
    keep.flat[depth.argmax()] |= depth.max() >= SMALLEST_SPHERE
    return keep


def _ball(
    shape: tuple[int, ...], place: NDArray[np.int64], radius: float
) -> tuple[tuple[slice, ...], NDArray[np.bool_]]:
    """The box around a ball in a grid, and the points of the box in the ball."""
    reach = int(radius)
    box = tuple(slice(max(p - reach, 0), min(p + reach + 1, n)) for p, n in zip(place, shape, strict=True))
    z, y, x = (np.arange(s.start, s.stop) - p for s, p in zip(box, place, strict=True))
    return box, z[:, None, None] ** 2 + y[:, None] ** 2 + x**2 <= radius**2


def union_properties(centers: Float, radii: Float, chords: int = CHORDS) -> MassProperties:
    """Mass properties of the union of spheres at density 1: exact along z, by the midpoint rule along x and y."""
    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)
    step = (high - low)[:2] / chords
    x, y = (low[k] + step[k] * (np.arange(chords) + 0.5) for k in (0, 1))
    square = radii**2 - (x[:, None, None] - centers[:, 0]) ** 2 - (y[:, None] - centers[:, 1]) ** 2
    half = np.sqrt(np.maximum(square, 0))
    start = np.where(square > 0, centers[:, 2] - half, np.inf)
    order = np.argsort(start, axis=-1)
    start = np.take_along_axis(start, order, axis=-1)
    end = np.take_along_axis(np.where(square > 0, centers[:, 2] + half, -np.inf), order, axis=-1)
    reached = np.maximum.accumulate(end, axis=-1)
    before = np.concatenate([np.full((chords, chords, 1), -np.inf), reached[..., :-1]], axis=-1)
    begin = np.maximum(start, before)
    valid = np.isfinite(begin) & (end > begin)
    a, b = np.where(valid, begin, 0), np.where(valid, end, 0)
    length, first, second = (((b**p - a**p) / p).sum(axis=-1) for p in (1, 2, 3))
    area = float(step.prod())
    gx, gy = np.broadcast_arrays(x[:, None], y[None])
    volume = float(length.sum()) * area
    middle = np.array([(gx * length).sum(), (gy * length).sum(), first.sum()]) * area / volume
    xx, yy, zz = (gx**2 * length).sum(), (gy**2 * length).sum(), second.sum()
    xy, xz, yz = (gx * gy * length).sum(), (gx * first).sum(), (gy * first).sum()
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * area - volume * np.outer(middle, middle)
    return MassProperties.of_moments(volume, middle, moments)
