"""Strain and rotation maps of one state from the motions of its grains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.columns import STRAIN_MAP_COLUMNS, STRAINS_CONTENT
from grainmotion.mechanics.finite_strain import Deformation, deviatoric_noise, propagated, standard_deviations
from grainmotion.mechanics.local_strain import fit_around
from grainmotion.mechanics.tetrahedra import Tessellation, tessellate
from grainmotion.model.described_table import described
from grainmotion.model.motions import Motions
from grainmotion.model.strain import STRAIN_NAMES
from grainmotion.model.summary import Summarised, Summary
from grainmotion.rotations import rotation_matrix, rotation_vector

if TYPE_CHECKING:
    import pandas as pd

Estimator = Literal["cells", "neighbours"]
INSIDE_OUT = "the grains around it are turned inside out (det F < 0): the motion of one of them is wrong"
NO_VOLUME = "the grains to use are fewer than four, or all on a line or in a plane other than one z"
DEFAULT_REACH = 2.0
"""Radius of local fits, in median distances of neighbouring centres: about the first shell of grains."""


@dataclass(frozen=True, eq=False, repr=False)
class Strains(Summarised):
    """Deformation of the sample at each of n grains, and their own rotations against it.

    Attributes
    ----------
    labels : (n,) int array
        Labels of all grains of the motions, in their order.
    centers : (n, 3) array
        Centres in the reference state, mm, x y z.
    gradients : (n, 3, 3) array
        F = ∂x/∂X of the continuum at each grain; NaN where it is not known, see ``reasons``.
    covariances : (n, 9, 9) array
        Of F, row by row; NaN where a motion that went into it has none.
    grain_rotations : (n, 3) array
        Rotation vectors of the grains themselves, radians; NaN where they are no result to use.
    relative_rotations, relative_covariances : (n, 3), (n, 3, 3) arrays
        Rotation of the grain after that of the continuum, ω of Ω Rᵀ with F = R U, radians, and its covariance.
    volumes : (n,) array
        Volume of the tetrahedra around the grain, mm³ (triangles of a slice: mm²); 0 without any.
    at_hull : (n,) bool array
        Grains on the boundary of the tessellation, where F is that of one side.
    non_affine : (n,) array
        Root mean square of the displacements about the local fit, mm; NaN for ``estimator = "cells"``.
    reasons : tuple of n str
        Why F is not known; empty where it is.
    estimator : {"cells", "neighbours"}
        How F was found.
    mean_gradient, mean_covariance : (3, 3), (9, 9) arrays
        F of the whole sample, the average over all tetrahedra by volume, and its covariance.

    Examples
    --------
    >>> field = gm.strains(motions)
    >>> field.mean_gradient.shape, field.gradients.shape
    ((3, 3), (4, 3, 3))
    """

    labels: NDArray[np.int64]
    centers: Float
    gradients: Float
    covariances: Float
    grain_rotations: Float
    relative_rotations: Float
    relative_covariances: Float
    volumes: Float
    at_hull: NDArray[np.bool_]
    non_affine: Float
    reasons: tuple[str, ...]
    estimator: Estimator
    mean_gradient: Float
    mean_covariance: Float

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def deformation(self) -> Deformation:
        """All strain measures of F: volumetric, deviatoric, small, Green–Lagrange, logarithmic, rotation."""
        return Deformation(self.gradients)

    @property
    def volumetric(self) -> Float:
        """Relative change of volume det F − 1, ``(n,)``; positive for dilation."""
        return self.deformation.volumetric

    @property
    def volumetric_sd(self) -> Float:
        """Its standard deviation, ``(n,)``."""
        found = propagated(lambda d: d.volumetric[:, None], self.gradients, self.covariances)
        return standard_deviations(found)[:, 0]

    @property
    def deviatoric(self) -> Float:
        """Deviatoric strain ‖U (det F)^(−1/3) − I‖, ``(n,)``."""
        return self.deformation.deviatoric

    @property
    def deviatoric_sd(self) -> Float:
        """Its standard deviation, ``(n,)``; NaN where it is not above twice `deviatoric_noise`."""
        found = propagated(lambda d: d.deviatoric[:, None], self.gradients, self.covariances)
        return np.where(self.deviatoric > 2 * self.deviatoric_noise, standard_deviations(found)[:, 0], np.nan)

    @property
    def deviatoric_noise(self) -> Float:
        """Root mean square of the deviatoric strain that the errors alone would show, ``(n,)``."""
        return deviatoric_noise(self.covariances)

    def to_dataframe(self) -> pd.DataFrame:
        """The table of ``strains.csv``: mm, degrees and numbers without a unit, one row a grain.

        Returns
        -------
        DataFrame
            Its ``attrs`` tell units and meanings of the columns, frame, version and estimator.
        """
        import pandas as pd  # takes half a second

        whole = self.deformation
        lagrange_sd, rotation_sd = (
            standard_deviations(propagated(measure, self.gradients, self.covariances))
            for measure in (lambda d: d.green_lagrange, lambda d: d.rotations)
        )
        axes = ("x", "y", "z")
        columns: dict[str, object] = {"label": self.labels}
        columns |= dict(zip(axes, self.centers.T, strict=True))
        columns |= {f"F{a}{b}": self.gradients[:, i, j] for i, a in enumerate(axes) for j, b in enumerate(axes)}
        columns |= {f"green_{n}": c for n, c in zip(STRAIN_NAMES, whole.green_lagrange.T, strict=True)}
        columns |= {f"sd_green_{n}": c for n, c in zip(STRAIN_NAMES, lagrange_sd.T, strict=True)}
        columns |= {"volumetric": self.volumetric, "sd_volumetric": self.volumetric_sd}
        columns |= {"deviatoric": self.deviatoric, "sd_deviatoric": self.deviatoric_sd}
        columns |= {"deviatoric_noise": self.deviatoric_noise}
        relative_sd = standard_deviations(self.relative_covariances)
        for name, vectors in (
            ("continuum_w", whole.rotations), ("sd_continuum_w", rotation_sd), ("grain_w", self.grain_rotations),
            ("relative_w", self.relative_rotations), ("sd_relative_w", relative_sd),
        ):  # fmt: skip
            columns |= {f"{name}{a}": np.rad2deg(c) for a, c in zip(axes, vectors.T, strict=True)}
        columns |= {"relative_angle": np.rad2deg(np.linalg.norm(self.relative_rotations, axis=1))}
        columns |= {"cell_volume": self.volumes, "at_hull": self.at_hull, "non_affine": self.non_affine}
        columns |= {"reason": list(self.reasons)}
        return described(pd.DataFrame(columns), STRAIN_MAP_COLUMNS, STRAINS_CONTENT, estimator=self.estimator)

    def _summary(self) -> Summary:
        known = int(np.isfinite(self.gradients).all(axis=(1, 2)).sum())
        small = Deformation(self.mean_gradient[None])
        rows = (
            ("F is known", f"of {known} of {len(self)} grains, by {self.estimator}"),
            ("whole sample", f"volumetric {small.volumetric[0]:.4g}, deviatoric {small.deviatoric[0]:.4g}"),
        )
        return Summary(f"Strains at {len(self)} grains", f"{known} known; {rows[1][1]}", rows)


@checked_arguments
def strains(motions: Motions, *, estimator: Estimator = "cells", reach: float = DEFAULT_REACH) -> Strains:
    """Strain of the sample at each grain, from the displacements of the grains' centres.

    Parameters
    ----------
    motions : Motions
        Of one state, mm and radians.  Grains whose translation is no result to use (``ok_translation``) are left out,
        and told in ``reasons``; centres are taken as exact, errors of different grains as independent.
    estimator : {"cells", "neighbours"}
        ``"cells"``: average over Delaunay's tetrahedra around a grain, by volume, the equivalent continuum of Bagi
        (Mechanics of Materials 22, 165, 1996).  ``"neighbours"``: an affine field fitted to the grains within a radius
        (see `grainmotion.mechanics.local_strain`).
    reach : float
        Radius of ``"neighbours"``, in median distances of neighbouring centres.

    Returns
    -------
    Strains
        F and what follows from it, with uncertainties, for every grain of ``motions``; F of the whole sample.

    Raises
    ------
    InputError
        If the estimator is unknown, or ``reach`` is not above 1.

    Examples
    --------
    >>> field = gm.strains(motions)
    >>> field.to_dataframe()[["label", "volumetric", "deviatoric"]].shape
    (4, 3)
    """
    if estimator not in ("cells", "neighbours"):
        raise InputError("strains.estimator", f"'{estimator}' is unknown", 'use "cells" or "neighbours"')
    if not reach > 1:
        raise InputError("strains.reach", f"must be > 1, got {reach}", "give median distances of centres, such as 2")
    n = len(motions)
    finite = np.isfinite(motions.translations).all(axis=1) & np.isfinite(motions.centers).all(axis=1)
    used = np.flatnonzero(motions.ok_translation & finite)
    points, moved = motions.centers[used], motions.translations[used]
    covariances = motions.covariances[used][:, :3, :3]
    cells = tessellate(points)
    around = cells.averages(len(used))
    volumes = cells.volumes_around(len(used))
    non_affine = np.full(n, np.nan)
    if estimator == "cells":
        weights, known = cells.weights.combined(around), volumes > 0
        absent = "no tetrahedron around it is left" if len(cells.volumes) else NO_VOLUME
    else:
        planar = cells.simplices.shape[1] == 3
        fits = fit_around(points, reach * _spacing(points, cells), planar=planar)
        weights, known = fits.weights, fits.determined
        non_affine[used] = fits.non_affine(moved, weights.gradients(moved))
        absent = "too few grains around it, or all nearly in one plane"
    gradients, of_gradients = np.full((n, 3, 3), np.nan), np.full((n, 9, 9), np.nan)
    gradients[used[known]] = weights.gradients(moved)[known]
    of_gradients[used[known]] = weights.covariances(covariances)[known]
    reasons = [
        f"translation not to use: {status}" if is_finite else "its motion or centre is NaN"
        for status, is_finite in zip(motions.statuses, finite | ~motions.ok_translation, strict=True)
    ]
    for row, is_known in zip(used, known, strict=True):
        reasons[row] = "" if is_known else absent
    for row in np.flatnonzero(np.isfinite(gradients[:, 0, 0]) & np.isnan(Deformation(gradients).volumetric)):
        gradients[row], of_gradients[row], reasons[row] = np.nan, np.nan, INSIDE_OUT
    at_hull, all_volumes = np.zeros(n, dtype=bool), np.zeros(n)
    at_hull[used], all_volumes[used] = cells.at_hull, volumes
    mean = _mean(cells, moved, covariances)
    rotations = np.where(motions.ok_rotation[:, None], motions.rotations, np.nan)
    relative, of_relative = _relative_rotations(motions, rotations, gradients, of_gradients)
    return Strains(
        motions.labels, motions.centers, gradients, of_gradients, rotations, relative, of_relative, all_volumes,
        at_hull, non_affine, tuple(reasons), estimator, *mean,
    )  # fmt: skip


def _spacing(points: Float, cells: Tessellation) -> float:
    """Median distance of neighbouring centres, mm."""
    corners = cells.simplices.shape[1]
    pairs = np.concatenate([cells.simplices[:, [a, b]] for a in range(corners) for b in range(a)])
    if not len(pairs):
        return 1.0
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    return float(np.median(np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)))


def _mean(cells: Tessellation, displacements: Float, covariances: Float) -> tuple[Float, Float]:
    """F of the whole sample and its covariance; NaN without tetrahedra."""
    if not len(cells.volumes):
        return np.full((3, 3), np.nan), np.full((9, 9), np.nan)
    weights = cells.weights.combined(csr_array(cells.volumes[None] / cells.volumes.sum()))
    return weights.gradients(displacements)[0], weights.covariances(covariances)[0]


def _relative_rotations(
    motions: Motions, rotations: Float, gradients: Float, covariances: Float
) -> tuple[Float, Float]:
    """Rotations of the grains after those of the continuum, and their covariances.

    A grain's own translation has a part in F, but hardly any in its rotation: the two are taken as independent.
    """
    known = np.isfinite(rotations).all(axis=1) & np.isfinite(gradients).all(axis=(1, 2))
    relative, found = np.full(rotations.shape, np.nan), np.full((len(motions), 3, 3), np.nan)
    of_continuum = Deformation(gradients[known]).rotations
    relative[known] = rotation_vector(
        rotation_matrix(rotations[known]) @ np.swapaxes(rotation_matrix(of_continuum), 1, 2)
    )
    found[known] = motions.covariances[known][:, 3:, 3:] + propagated(
        lambda d: d.rotations, gradients[known], covariances[known]
    )
    return relative, found
