"""Cross-validation of corrections: the residual of half of the views in a reconstruction of the other half."""

from __future__ import annotations

from functools import partial

import numpy as np
from pydantic.dataclasses import dataclass

from grainmotion._typing import Float
from grainmotion.calibration.corrections import Parameter, corrected, step_of_a_pixel
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.task_map import each
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_grid, binned_scan
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.fit import fitted_volume
from grainmotion.reconstruction.settings import ReconstructSettings

DIFFERENCE_STEP = 0.5
"""Half the span of a central difference, in the unit of a correction."""


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Trial:
    """A binned scan and its grid, on which corrections are tried.

    ``units`` are the corrections, mm and radians, that move the edge of a footprint by about one binned pixel.
    """

    scan: Scan
    grid: Volume
    names: tuple[Parameter, ...]
    units: Float
    sweeps: int

    @classmethod
    def of(cls, scan: Scan, grid: Volume, factor: int, names: tuple[Parameter, ...], sweeps: int) -> Trial:
        """Radiographs and voxels ``factor`` times as large."""
        small = binned_scan(scan, factor)
        units = np.array([step_of_a_pixel(name, small.geometry) for name in names])
        return cls(small, binned_grid(grid, factor), names, units, sweeps)

    def correct(self, geometry: Geometry, values: Float) -> Geometry:
        """A geometry corrected by values in the order of ``names``."""
        return corrected(geometry, dict(zip(self.names, values.tolist(), strict=True)))

    def residual(self, values: Float) -> Float:
        """r(γ), flat, view after view."""
        out = np.zeros(self.scan.line_integrals.shape)
        for half, outside in enumerate(each(partial(self.residual_outside, values), (0, 1))):
            out[1 - half :: 2] = outside
        return out.ravel()

    def residual_outside(self, values: Float, half: int) -> Float:
        """r(γ) of the views that are not in a half, 0 or 1, ``(views, rows, columns)``."""
        geometry, images, valid = self.correct(self.scan.geometry, values), self.scan.line_integrals, self.scan.valid
        inside, outside = slice(half, None, 2), slice(1 - half, None, 2)
        scan = Scan(images[inside], geometry[inside], None if valid is None else valid[inside])
        settings = ReconstructSettings(method="sart", sweeps=self.sweeps, tolerance=0, outline="grid")
        volume = fitted_volume(scan, self.grid, settings).volume
        out = images[outside].astype(float) - project(volume, geometry[outside])
        return out if valid is None else np.where(valid[outside], out, 0)

    def relative(self, values: Float) -> float:
        """‖r‖/‖b‖."""
        return float(np.linalg.norm(self.residual(values)) / np.linalg.norm(self.scan.line_integrals))

    def derivatives(self, values: Float) -> Float:
        """∂r by each correction in its unit, ``(pixels, parameters)``."""
        steps = DIFFERENCE_STEP * np.diag(self.units)
        residuals = each(self.residual, [*(values + steps), *(values - steps)])
        differences = [ahead - behind for ahead, behind in zip(residuals, residuals[len(steps) :], strict=False)]
        return np.stack(differences, axis=1) / (2 * DIFFERENCE_STEP)
