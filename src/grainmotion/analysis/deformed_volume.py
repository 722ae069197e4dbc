"""The volume of the current configuration, from the grains of the reference and their motions.

Each voxel centre x of the grid is pulled back into the grain's own voxels by the inverse motion,
X = F⁻¹(x − u − c) + c with F = Ω U (see `model.strain`), and the grain's attenuation is interpolated there
trilinearly, so that a moved grain has no holes; that of a strained grain is divided by det U, which keeps its
mass.  The contributions of all grains and bodies add up, and that of a liquid: up to the level and with the
attenuation that the state found, else as in the reference, and displaced by the moved grains.

A voxel carries the label of the grain that contributes most to it, provided that this contribution
exceeds half of that grain's typical attenuation: the attenuation below which half of the grain's mass
lies.  (This median by mass is robust against a dense inclusion and a halo of partly filled voxels.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.kernels import resample
from grainmotion.model.fluid import Fluid
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.motions import Motions, Status
from grainmotion.model.pose import Pose
from grainmotion.model.progress import counted
from grainmotion.model.volume import Volume
from grainmotion.projection.displaced_fluid import Submersion
from grainmotion.rotations import recenter

WITHOUT_MOTION = (Status.LEFT_FIELD.value, Status.NOT_FITTED.value, Status.ABSENT.value)


@checked_arguments
def rebuild(grains: GrainSet, motions: Motions, grid: Volume) -> tuple[Volume, NDArray[np.int32]]:
    """Rebuild the volume of the current configuration on a grid.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state.  Those without a row in ``motions`` are left out.
    motions : Motions
        Their motions, mm and radians.  Grains whose motion is NaN, or whose status is ``left-field``,
        ``not-fitted`` or ``absent``, are left out.
    grid : Volume
        The voxels to fill; its values do not matter.

    Returns
    -------
    volume : Volume
        Attenuation of the current configuration, 1/mm, on the grid.
    labels : (nz, ny, nx) int32 array
        Label of the grain that holds each voxel, 0 for none.

    Raises
    ------
    InputError
        If ``motions`` names a label that is not among the grains.

    Examples
    --------
    >>> moved, moved_labels = gm.rebuild(grains, motions, volume)
    >>> np.unique(moved_labels).tolist()
    [0, 1, 2, 3, 4]
    """
    by_label = {g.label: g for g in grains.grains}
    unknown = sorted({int(label) for label in motions.labels} - set(by_label))
    if unknown:
        fact = f"labels {unknown[:10]} are not among the grains"
        raise InputError("motions.label", fact, "use motions of this reference")
    total = np.zeros(grid.shape, np.float32)
    best = np.zeros(grid.shape, np.float32)
    labels = np.zeros(grid.shape, np.int32)
    gradients = motions.gradients
    finite = np.isfinite(motions.translations).all(axis=1) & np.isfinite(motions.rotations).all(axis=1)
    shown = np.flatnonzero(finite & ~np.isin(motions.statuses, WITHOUT_MOTION))
    in_liquid, liquid = _in_liquid(grains, motions, shown)
    for i in counted(shown):
        grain = by_label[int(motions.labels[i])]
        gradient, volume = gradients[i], grain.coarse_volume
        matrix, offset = _pull_back(volume, grid, gradient, motions.translations[i], motions.centers[i])
        low, high = _bounds(volume, matrix, offset, grid.shape)
        density = 1.0 if motions.strains is None else 1 / float(np.linalg.det(gradient))
        half = np.float32(density * typical_attenuation(grain) / 2)
        array = volume.array if density == 1 else (density * volume.array).astype(np.float32)
        resample.add_moved_label(array, matrix, offset, low, high, total, np.int32(grain.label), half, best, labels)
        changed = in_liquid.get(grain.label)
        if changed is not None:  # labels follow the excess over the reference's liquid, which is even within a grain
            change = (density * (changed - volume.array)).astype(np.float32)
            resample.add_moved(change, matrix, offset, low, high, total)
    moved = {body.name: body for body in motions.fit.bodies}
    for body in grains.scene.bodies:
        motion = moved.get(body.name)
        u, rotation = (np.zeros(3), np.eye(3)) if motion is None else (motion.translation, motion.matrix)
        matrix, offset = _pull_back(body.volume, grid, rotation, u, body.center)
        low, high = _bounds(body.volume, matrix, offset, grid.shape)
        resample.add_moved(body.volume.array, matrix, offset, low, high, total)
    if liquid is not None:
        matrix, offset = _pull_back(liquid.space, grid, np.eye(3), np.zeros(3), np.zeros(3))
        low, high = _bounds(liquid.space, matrix, offset, grid.shape)
        resample.add_moved(liquid.volume.array, matrix, offset, low, high, total)
    return Volume(total, grid.voxel_size, grid.center), labels


def _in_liquid(
    grains: GrainSet, motions: Motions, rows: NDArray[np.integer]
) -> tuple[dict[int, NDArray[np.floating]], Fluid | None]:
    """The liquid of a state, and what grains at ``rows`` of the motions add to it, by label, if not their excess."""
    fluid, fit = grains.scene.fluid, motions.fit.fluid
    if fluid is None or fit is None or not len(rows):
        return {}, fluid if fit is None or fluid is None else fluid.found(fit)
    row_of = {int(motions.labels[row]): int(row) for row in rows}
    kept = grains.without([k for k, g in enumerate(grains.grains) if g.label not in row_of])
    at = [row_of[g.label] for g in kept.grains]
    shifts = recenter(motions.gradients[at], motions.translations[at], motions.centers[at], kept.centers)
    effective = Submersion(kept).in_state(fit, Pose(shifts, motions.gradients[at]))
    pairs = zip(kept.grains, effective.grains, strict=True)
    return {old.label: new.volume.array for old, new in pairs if new is not old}, fluid.found(fit)


def typical_attenuation(grain: Grain) -> float:
    """The attenuation below which half of a grain's mass lies, 1/mm; 0 for an empty grain."""
    array = grain.volume.array
    values = array[array > 0]
    if values.size == 0:
        return 0.0
    values = np.sort(values).astype(float)
    mass = np.cumsum(values)
    return float(values[np.searchsorted(mass, mass[-1] / 2)])


def _pull_back(
    source: Volume,
    grid: Volume,
    gradient: NDArray[np.float64],
    translation: NDArray[np.float64],
    center: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A and b that carry voxel indices (x y z) of the grid to those of the source in its reference place."""
    back = np.linalg.inv(gradient).astype(float)
    start = back @ (grid.origin - translation - center) + center - source.origin
    return back * (grid.voxel_size / source.voxel_size), start / source.voxel_size


def _bounds(
    source: Volume, matrix: NDArray[np.float64], offset: NDArray[np.float64], shape: tuple[int, int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First voxel (x y z) of the grid that the moved source touches, and the one past the last."""
    ends = np.array([[-1, n] for n in source.shape[::-1]], dtype=float)
    corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 3)
    places = np.linalg.solve(matrix, (corners - offset).T).T
    limit = np.array(shape[::-1])
    low = np.clip(np.ceil(places.min(axis=0)), 0, limit).astype(np.int64)
    high = np.clip(np.floor(places.max(axis=0)) + 1, 0, limit).astype(np.int64)
    return low, np.maximum(low, high)
