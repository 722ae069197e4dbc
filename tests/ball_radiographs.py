"""Radiographs of a few balls in a parallel beam, from chords in numpy: counts, flats and darks of a 16-bit camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion.diagnosis.frames import frame_findings
from grainmotion.diagnosis.grey_values import grey_value_findings
from grainmotion.diagnosis.read_scan import ReadScan
from grainmotion.model.finding import Finding
from grainmotion.model.geometry import Geometry
from grainmotion.preprocessing.flat_field import (
    checked_line_integrals,
    line_integrals_from_counts,
    line_integrals_from_transmission,
)
from grainmotion.preprocessing.outliers import panel_facts

PANEL = (40, 48)
BEAM, DARK = 20_000, 100  # counts
BALLS = np.array([[-8.0, -6, -9, 6], [7, -7, -8, 7], [0, 9, -6, 6], [-6, 2, 7, 7], [8, 3, 8, 6]])  # x y z radius
ATTENUATION = 0.04  # 1/pixel


def line_integrals(angles_deg: NDArray[np.floating], balls: NDArray[np.floating] = BALLS) -> NDArray[np.floating]:
    """Line integrals ``(views, rows, columns)``, averaged over 3 x 3 rays a pixel."""
    steps = (np.arange(3) - 1) / 3
    rows = (np.arange(PANEL[0])[:, None] + steps).ravel() - (PANEL[0] - 1) / 2
    columns = (np.arange(PANEL[1])[:, None] + steps).ravel() - (PANEL[1] - 1) / 2
    images = []
    for angle in np.deg2rad(angles_deg):
        image = np.zeros((len(rows), len(columns)))
        for x, y, z, radius in balls:
            along = columns - (x * np.cos(angle) + y * np.sin(angle))
            image += 2 * np.sqrt(np.maximum(radius**2 - along**2 - (rows[:, None] - z) ** 2, 0))
        image = np.exp(-ATTENUATION * image).reshape(PANEL[0], 3, PANEL[1], 3).mean(axis=(1, 3))
        images.append(-np.log(image))
    return np.array(images)


@dataclass(frozen=True, eq=False)
class Measured:
    """What the camera recorded; ``kind`` as in the experiment file."""

    images: NDArray
    flats: NDArray | None
    darks: NDArray | None
    angles_deg: NDArray
    kind: str = "counts"
    key: str = "reference"

    def having(self, **changes: object) -> Measured:
        return replace(self, **changes)

    def read(self, saturation: float | None = None) -> ReadScan:
        geometry = Geometry.parallel(self.angles_deg, PANEL, 1.0)
        panel = panel_facts(self.images, self.flats)
        if self.kind == "counts":
            scan, pixels = line_integrals_from_counts(
                self.images, self.flats, self.darks, geometry, saturation=saturation, panel=panel
            )
        elif self.kind == "transmission":
            scan, pixels = line_integrals_from_transmission(self.images, geometry, panel=panel)
        else:
            scan, pixels = checked_line_integrals(self.images, geometry, panel=panel)
        names = {name: name for name in ("radiographs", "flats", "darks")}
        return ReadScan(self.key, names, self.kind, self.images, self.flats, self.darks, scan, pixels, panel.top)

    def findings(self) -> tuple[Finding, ...]:
        read = self.read()
        return *frame_findings(read), *grey_value_findings(read)


def measured(seed: int, *, state: bool = False, photons: int = BEAM) -> Measured:
    """A sound full scan, or a sound later state of four views."""
    rng = np.random.default_rng(seed)
    angles = np.array([0.0, 45, 90, 135]) if state else np.arange(48) * 7.5
    counts = [
        rng.poisson(photons * np.exp(-line)) * (BEAM / photons) + rng.poisson(DARK, line.shape)
        for line in (line_integrals(angles), np.zeros((8, *PANEL)))
    ]
    images, flats = (c.astype(np.uint16) for c in counts)
    darks = rng.poisson(DARK, flats.shape).astype(np.uint16)
    return Measured(images, flats, darks, angles, key="states.later" if state else "reference")


def transmissions(scan: Measured) -> NDArray[np.float32]:
    """I/I0 of counts, with the nominal beam."""
    return ((scan.images.astype(float) - DARK) / BEAM).astype(np.float32)
