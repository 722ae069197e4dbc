"""Scan: line integrals with their geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.geometry import Geometry


@dataclass(frozen=True, eq=False)
class Scan:
    """Radiographs as line integrals −ln((I − dark)/(flat − dark)), with the views that saw them.

    Attributes
    ----------
    line_integrals : (views, rows, columns) float32 array
        Dimensionless; finite everywhere (repaired where ``valid`` is False).
    geometry : Geometry
        One view a radiograph.
    valid : (views, rows, columns) bool array, optional
        False where the pixel was dead, saturated or dark and must carry no weight; None if all are good.

    Raises
    ------
    InputError
        If shapes disagree or a line integral is not finite.
    """

    line_integrals: NDArray[np.float32]
    geometry: Geometry
    valid: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        images = np.ascontiguousarray(self.line_integrals, dtype=np.float32)
        expected = (len(self.geometry), *self.geometry.shape)
        if images.shape != expected:
            raise InputError(
                "scan",
                f"radiographs {images.shape} do not match the geometry {expected} (views, rows, columns)",
                "give one geometry row a radiograph",
            )
        if not np.isfinite(images).all():
            raise InputError("scan", "line integrals hold NaN or infinity", "repair or mask those pixels")
        if self.valid is not None and self.valid.shape != expected:
            raise InputError("scan", f"mask {self.valid.shape} does not match {expected}", "give one flag a pixel")
        object.__setattr__(self, "line_integrals", images)

    def __len__(self) -> int:
        return len(self.geometry)

    def select(self, views: slice | list[int] | NDArray[np.int_]) -> Scan:
        """The scan of some views, in the order asked for."""
        valid = None if self.valid is None else self.valid[views]
        return Scan(self.line_integrals[views], self.geometry[views], valid)

    def __repr__(self) -> str:
        return f"<Scan of {len(self)} {self.geometry.beam}-beam radiographs, {self.geometry.shape}>"
