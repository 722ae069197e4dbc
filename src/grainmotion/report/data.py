"""The data that a report shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume

Rows = tuple[tuple[str, str], ...]
"""Facts: name and value, the value as text with its unit."""


@dataclass(frozen=True, eq=False)
class StateReport:
    """One later state.

    Attributes
    ----------
    name : str
        The state's name.
    measured, simulated : (views, rows, columns) array
        Line integrals, dimensionless; ``simulated`` with gain and offset applied.  NaN where a pixel
        carries no weight.
    motions : Motions
        The measured motions, mm and radians.
    voxel_size : float
        Edge of a voxel, mm: lengths are also given in voxels.
    residual : (views, rows, columns) array, optional
        Measured − simulated; their difference if not given.
    views : tuple of str, optional
        Caption of each view, such as its angle; numbered if not given.
    comparison : tuple of (str, str)
        Facts of a comparison with another measurement or with the true motions, if there is one.
    first_row : {"bottom", "top"}
        Whether row 0 of the radiographs is their lowest (v along +z) or highest row; the page shows +z upwards.
    """

    name: str
    measured: NDArray[np.floating]
    simulated: NDArray[np.floating]
    motions: Motions
    voxel_size: float
    residual: NDArray[np.floating] | None = None
    views: tuple[str, ...] = ()
    comparison: Rows = ()
    first_row: Literal["bottom", "top"] = "bottom"

    def __post_init__(self) -> None:
        where = f"report of state '{self.name}'"
        measured, simulated = np.asarray(self.measured), np.asarray(self.simulated)
        residual = measured - simulated if self.residual is None else np.asarray(self.residual)
        if measured.ndim != 3 or measured.size == 0:
            raise InputError(where, f"radiographs of shape {measured.shape}", "give (views, rows, columns)")
        for name, images in (("simulated", simulated), ("residual", residual)):
            if images.shape != measured.shape:
                raise InputError(where, f"{name} {images.shape}, measured {measured.shape}", "give the same views")
        if not self.voxel_size > 0:
            raise InputError(where, f"voxel_size must be > 0, got {self.voxel_size}", "give it in mm")
        views = tuple(str(v) for v in self.views) or tuple(f"view {i}" for i in range(len(measured)))
        if len(views) != len(measured):
            raise InputError(where, f"{len(views)} captions for {len(measured)} views", "give one a view")
        object.__setattr__(self, "measured", measured)
        object.__setattr__(self, "simulated", simulated)
        object.__setattr__(self, "residual", residual)
        object.__setattr__(self, "views", views)


@dataclass(frozen=True, eq=False)
class ReportData:
    """The data of one page.

    Attributes
    ----------
    title : str
        Heading of the page.
    facts : tuple of (str, str)
        Facts of the reference state: views, voxel size, threshold, number of grains...
    reconstruction_errors : tuple of float
        Relative residual ε = ‖b − Ax‖/‖b‖ after each iteration of the reconstruction; empty if none was run.
    volume : Volume, optional
        The reference volume, of which the page shows the central slices.
    labels : (nz, ny, nx) integer array, optional
        Its labels, 0 for none.
    states : tuple of StateReport
        In loading order.
    """

    title: str
    facts: Rows = ()
    reconstruction_errors: tuple[float, ...] = ()
    volume: Volume | None = None
    labels: NDArray[np.integer] | None = None
    states: tuple[StateReport, ...] = ()

    def __post_init__(self) -> None:
        if self.labels is not None and (self.volume is None or self.labels.shape != self.volume.shape):
            shape = None if self.volume is None else self.volume.shape
            raise InputError("report", f"labels {self.labels.shape} for a volume {shape}", "give both on one grid")
        names = [state.name for state in self.states]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise InputError("report", f"states {repeated} appear twice", "give each state its own name")
