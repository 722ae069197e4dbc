"""The data that a report shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.model.finding import Finding
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scene import Body
from grainmotion.model.volume import Volume

Rows = tuple[tuple[str, str], ...]
"""Facts: name and value, the value as text with its unit."""


@dataclass(frozen=True, eq=False)
class StateReport:
    """One later state.

    Radiographs are line integrals ``(views, rows, columns)``, NaN where a pixel carries no weight, ``simulated`` with
    gain and offset applied.  Row 0 is their lowest (v along +z) or highest row; the page shows +z upwards.
    """

    name: str
    measured: NDArray[np.floating]
    simulated: NDArray[np.floating]
    motions: Motions
    voxel_size: float  # mm
    residual: NDArray[np.floating] | None = None  # measured − simulated if not given
    views: tuple[str, ...] = ()  # captions, such as angles; numbered if not given
    comparison: Rows = ()  # with another measurement or with the truth
    first_row: Literal["bottom", "top"] = "bottom"
    geometry: Geometry | None = None  # of the radiographs, for the grains' shadows
    time: float | None = None  # of the state, in the unit of the experiment file

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
        if self.geometry is not None and (len(self.geometry), *self.geometry.shape) != measured.shape:
            seen = (len(self.geometry), *self.geometry.shape)
            raise InputError(where, f"geometry of {seen}, radiographs {measured.shape}", "give that of these views")
        object.__setattr__(self, "measured", measured)
        object.__setattr__(self, "simulated", simulated)
        object.__setattr__(self, "residual", residual)
        object.__setattr__(self, "views", views)


@dataclass(frozen=True)
class RunRecord:
    """What made the results: enough to make them again."""

    command: str  # what a shell runs to make the results again
    settings: str  # TOML, those that differ from the defaults
    versions: Rows = ()  # program and version; a short list of the page's own if empty
    machine: str = ""
    folder: str = ""  # of the results
    inputs: Rows = ()  # key of the experiment file, and the files


@dataclass(frozen=True, eq=False)
class ReportData:
    """The data of one page."""

    title: str
    facts: Rows = ()  # of the reference state: views, voxel size, threshold, number of grains...
    reconstruction_errors: tuple[float, ...] = ()  # ε = ‖b − Ax‖/‖b‖ after each iteration
    volume: Volume | None = None  # the reference volume, of which the page shows the central slices
    labels: NDArray[np.integer] | None = None  # its labels, 0 for no grain
    states: tuple[StateReport, ...] = ()  # in loading order
    bodies: tuple[Body, ...] = ()  # beside the grains in the reference: pistons, a wall
    findings: tuple[Finding, ...] = ()  # of checks of the input and of the results
    run: RunRecord | None = None  # None where no experiment file made the results

    def __post_init__(self) -> None:
        if self.labels is not None and (self.volume is None or self.labels.shape != self.volume.shape):
            shape = None if self.volume is None else self.volume.shape
            raise InputError("report", f"labels {self.labels.shape} for a volume {shape}", "give both on one grid")
        names = [state.name for state in self.states]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise InputError("report", f"states {repeated} appear twice", "give each state its own name")
