"""Reconstruction: Scan → Volume by SART, with the projector that tracking uses.

One update a view i, in golden-ratio order (Andersen and Kak 1984; Khalili et al. 2017, §2.3):

    x ← max(0, x + λ/C Aᵢᵀ[(bᵢ − Aᵢ x)/(Aᵢ 1)])

with C the column sums of Aᵢ, which are h³ over the area of a pixel carried back to the sample.  The
paper demands the same operator here as in the tracker; see `project.Projector`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from grainmotion.geometry import Geometry
from grainmotion.grains import PADDING
from grainmotion.kernels import sart, voxels
from grainmotion.project import Projector, pad, padded_origin
from grainmotion.scan import Scan
from grainmotion.volume import Volume

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ReconstructSettings:
    """How to reconstruct the reference."""

    projector: Annotated[Projector, Field(description="operator shared by reconstruction and tracking")] = "trilinear"
    sweeps: Annotated[int, Field(ge=1, description="most sweeps over all views")] = 6
    relaxation: Annotated[float, Field(gt=0, lt=2, description="λ of the first sweep")] = 1.0
    decay: Annotated[float, Field(gt=0, le=1, description="factor on λ after each sweep")] = 0.5
    tolerance: Annotated[float, Field(ge=0, description="stop once a sweep lowers ε by less than this share")] = 0.02
    noise: Annotated[
        float | None,
        Field(gt=0, description="stop once ε reaches this relative noise, 1/SNR (discrepancy principle)"),
    ] = None
    non_negative: Annotated[bool, Field(description="keep attenuation at or above zero")] = True
    circular: Annotated[bool, Field(description="reconstruct inside the grid's upright inscribed cylinder only")] = True


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Reconstruction:
    """A reconstructed volume and how it came about.

    Attributes
    ----------
    volume : Volume
        Attenuation, 1/mm.
    residuals : tuple of float
        Relative residual ε = ‖b − A x‖/‖b‖ (Eq. 23) of each sweep, each view just before its update.
    """

    volume: Volume
    residuals: tuple[float, ...]


def reconstruct(
    scan: Scan,
    grid: Volume,
    settings: ReconstructSettings | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Reconstruct a scan by SART.

    Parameters
    ----------
    scan : Scan
        Line integrals of the full scan.
    grid : Volume
        Where to reconstruct; its values are the start (zeros as a rule).
    settings : ReconstructSettings, optional
        Projector, sweeps, relaxation and stopping rule.
    progress : callable, optional
        Called as ``progress(message, done, total)`` after each view; the message carries ε.

    Returns
    -------
    Reconstruction
        The volume on ``grid`` and ε after each sweep.
    """
    settings = settings or ReconstructSettings()
    image = pad(grid.array.astype(np.float32))
    radius = _radius(grid, settings)
    order = golden_order(len(scan))
    steps = settings.relaxation / _column_sums(scan.geometry, grid)
    history: list[float] = []
    for sweep in range(settings.sweeps):
        squares = np.zeros(2)
        for done, view in enumerate(order, start=1):
            squares += _update(image, scan, grid, view, steps[view] * settings.decay**sweep, settings)
            sart.constrain(image, PADDING, radius, settings.non_negative)
            if progress is not None:
                message = f"SART sweep {sweep + 1}/{settings.sweeps}, ε = {_ratio(squares):.4f}"
                progress(message, sweep * len(order) + done, settings.sweeps * len(order))
        history.append(_ratio(squares))
        if _settled(history, settings):
            break
    inner = slice(PADDING, -PADDING)
    return Reconstruction(Volume(image[inner, inner, inner], grid.voxel_size, grid.center), tuple(history))


def golden_order(views: int) -> NDArray[np.int64]:
    """Views 0 … n − 1 in golden-ratio order: each next one far from those just used."""
    fractions = (np.arange(views) * (np.sqrt(5) - 1) / 2) % 1.0
    return np.argsort(np.argsort(fractions)).astype(np.int64)


def _update(
    image: NDArray[np.float32],
    scan: Scan,
    grid: Volume,
    view: int,
    step: float,
    settings: ReconstructSettings,
) -> NDArray[np.float64]:
    """One view's update, in place; returns Σ(b − Ax)² and Σb²."""
    rows, columns = scan.geometry.shape
    correction = np.empty((1, rows, columns), np.float32)
    squares = np.zeros((rows, 2))
    vectors, cone = scan.geometry.vectors[view : view + 1], scan.geometry.beam == "cone"
    exact, origin = settings.projector == "exact", padded_origin(grid)
    valid = np.ones((rows, columns), np.bool_) if scan.valid is None else scan.valid[view]
    sart.residual(
        image, origin, grid.voxel_size, vectors[0], cone, exact, _radius(grid, settings),
        scan.line_integrals[view].astype(np.float32), valid, correction[0], squares,
    )  # fmt: skip
    correction *= step
    voxels.adjoint(correction, origin, grid.voxel_size, vectors, cone, exact, image)
    return squares.sum(axis=0)


def _column_sums(geometry: Geometry, grid: Volume) -> NDArray[np.float64]:
    """Column sums of each view at the grid's centre: h³ over the area of a pixel seen along the ray there."""
    s, d, u, v = (geometry.vectors[:, i : i + 3] for i in (0, 3, 6, 9))
    normal = np.cross(u, v)
    if geometry.beam == "cone":
        ray = np.array(grid.center) - s
        shrink = (ray * normal).sum(1) / ((d - s) * normal).sum(1)
    else:
        ray, shrink = s, np.ones(len(s))
    area = np.abs((ray * normal).sum(1)) / np.linalg.norm(ray, axis=1) * shrink**2
    return grid.voxel_size**3 / area


def _radius(grid: Volume, settings: ReconstructSettings) -> float:
    """Radius of the grid's inscribed upright cylinder, voxels; 0 for none."""
    return min(grid.shape[1:]) / 2 if settings.circular else 0.0


def _ratio(squares: NDArray[np.float64]) -> float:
    return float(np.sqrt(squares[0] / squares[1])) if squares[1] > 0 else 0.0


def _settled(history: list[float], settings: ReconstructSettings) -> bool:
    if settings.noise is not None and history[-1] <= settings.noise:
        return True
    return len(history) > 1 and history[-1] > history[-2] * (1 - settings.tolerance)
