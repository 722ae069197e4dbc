"""Inspection of an experiment's data before any work: shapes, pixels, memory, and what is unusual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.calibration.beam_level import beam_levels
from grainmotion.diagnosis.hypotheses import stage_angles_deg
from grainmotion.diagnosis.scan_geometry import check_scan
from grainmotion.experiment.beam_level import finding, levels_wanted
from grainmotion.experiment.config import ExperimentFile
from grainmotion.experiment.given_inputs import (
    given_label_findings,
    given_volume_findings,
    read_given_labels,
    read_given_volume,
)
from grainmotion.experiment.inputs import Inputs, cylinder_circle
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.masked_pixels import PixelReport
from grainmotion.reconstruction.grid_growth import GROWN_REMEDY, fitted_grid, growth_views

MAX_AIR_LINE_INTEGRAL = 0.02  # median over the outermost columns; more gives a warning
MAX_AIR_VARIATION = 0.03  # of the outermost columns along them, over their line integral; a sample has 0.05 to 1
USUAL_VOXEL_PIXEL_RATIO = (0.4, 2.5)  # of a voxel and a pixel at the sample; others give a warning
MAX_PANEL_OVERHANG = 0.1  # of the volume beyond the panel, as a share of its columns; more gives a warning
DRAWN_STEPS_DEG = np.array([0.0, 15.0, 40.0, 90.0])  # angles from view 0 of the radiographs that a picture shows
BYTES_OF_PROGRAM = 0.44e9  # Python, the libraries and the compiled kernels
BYTES_PER_VOXEL = 60  # volume, labels, distances and grown labels in segmentation; grains and their patches in tracking
BYTES_OF_VOLUMES = 12  # of those: a volume, its last change and its labels, or what segmentation keeps of it
BYTES_BEFORE_COMPACT, BYTES_PER_COMPACT_VOXEL, BYTES_PER_COMPACT_PIXEL = 0.25e9, 11, 6  # where grains are many
BYTES_PER_REFERENCE_PIXEL = 8  # radiographs of the reference scan and their residuals


@dataclass(frozen=True)
class ScanFacts:
    """Facts about one scan."""

    key: str  # "reference" or "states.NAME"
    views: int
    rows: int
    columns: int
    dtype: str  # number type of the files
    kind: str  # what their pixels are, as in `ScanInput`
    beam: str
    pixel_at_sample: float  # pixel size over the magnification, mm
    magnification: float  # at the volume's centre
    air: float  # median line integral of the two outermost columns
    air_variation: float  # standard deviation of the same along the columns, without the noise
    highest: float  # highest line integral
    pixels: PixelReport


@dataclass(frozen=True, eq=False)
class FirstViews:
    """The first radiographs of a scan, for a picture."""

    name: str
    scan: Scan  # of these views only
    views: tuple[int, ...]  # their numbers in the whole scan

    @classmethod
    def of(cls, name: str, scan: Scan) -> FirstViews:
        """Radiographs near `DRAWN_STEPS_DEG` from the first, or all of a few."""
        views = drawn_views(scan.geometry)
        return cls(name, scan.select(views), tuple(views.tolist()))


def drawn_views(geometry: Geometry) -> Index:
    """Numbers of the views near `DRAWN_STEPS_DEG` from the first, or of all of a few."""
    if len(geometry) <= len(DRAWN_STEPS_DEG):
        return np.arange(len(geometry))
    angles = stage_angles_deg(geometry)
    return np.unique(np.abs(np.abs(angles - angles[0])[:, None] - DRAWN_STEPS_DEG).argmin(axis=0))


@dataclass(frozen=True)
class Inspection:
    """Facts about an experiment."""

    scans: tuple[ScanFacts, ...]  # the reference first
    volume_shape: tuple[int, int, int]  # voxels along z, y, x
    voxel_size: float  # mm
    memory: float  # estimate of the peak, bytes
    findings: tuple[Finding, ...]  # unusual facts, each with a remedy
    first_views: tuple[FirstViews, ...] = ()  # of each scan, for a picture

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings that are more than notes, as sentences."""
        return tuple(str(f) for f in self.findings if f.level is not Level.NOTE)


def inspect_inputs(inputs: Inputs, tables: ExperimentFile) -> Inspection:
    """Read all radiographs once and report facts and what is unusual, as a run would before its reconstruction."""
    facts: list[ScanFacts] = []
    findings: list[Finding] = []
    first_views: list[FirstViews] = []
    first_state: Scan | None = None
    for source in (inputs.reference, *inputs.states):
        if source is None:
            continue
        scan, pixels, as_read = source.read_checked()
        facts.append(scan_facts(source, scan, pixels, inputs.grid))
        first_views.append(FirstViews.of(source.key.removeprefix("states."), scan))
        findings += (*source.findings, *as_read, *scan_findings(source, facts[-1], inputs.grid))
        readable = not any(f.level is Level.ERROR for f in (*source.findings, *as_read))
        if source is inputs.reference and readable:  # else a run would stop before
            findings += _reference_findings(source, scan, inputs.grid, tables)
        elif first_state is None and inputs.volume is not None:
            first_state = scan
    if inputs.volume is not None:
        volume = read_given_volume(inputs.volume, inputs.grid)
        findings += given_volume_findings(inputs, volume, first_state)
        if inputs.labels is not None:
            findings += given_label_findings(inputs, volume, read_given_labels(inputs.labels))
    if not inputs.states:
        findings.append(_warning("states", "no states", "add a [[states]] table for each later state"))
    grid = inputs.grid
    memory = peak_memory(inputs)
    return Inspection(tuple(facts), grid.shape, grid.voxel_size, memory, tuple(findings), tuple(first_views))


def peak_memory(inputs: Inputs) -> float:
    """Estimate of the memory of a run at its peak, bytes: by voxels and pixels, without reading a radiograph."""
    voxels, pixels = float(np.prod(inputs.grid.shape)), 0.0
    if inputs.reference is not None:
        geometry = inputs.reference.geometry
        pixels = len(geometry) * float(np.prod(geometry.shape))
    small = BYTES_PER_VOXEL * voxels + BYTES_PER_REFERENCE_PIXEL * pixels
    large = BYTES_BEFORE_COMPACT + BYTES_PER_COMPACT_VOXEL * voxels + BYTES_PER_COMPACT_PIXEL * pixels
    return BYTES_OF_PROGRAM + min(small, large)


def large_arrays_bytes(inputs: Inputs) -> float:
    """Estimate of what a run keeps in radiographs, volumes and labels at a time, bytes."""
    volumes = BYTES_OF_VOLUMES * float(np.prod(inputs.grid.shape))
    if inputs.reference is None:
        return volumes
    geometry = inputs.reference.geometry
    return volumes + BYTES_PER_REFERENCE_PIXEL * len(geometry) * float(np.prod(geometry.shape))


def _reference_findings(source: ScanInput, scan: Scan, grid: Volume, tables: ExperimentFile) -> list[Finding]:
    """The level of the beam, and the geometry of the full scan with that level taken off."""
    found = list[Finding]()
    if levels_wanted(tables, source):
        levels = beam_levels(scan, grid, tables.reconstruct)
        if levels.source != "none":
            found.append(finding(levels, source))
            scan = scan.levelled(levels.levels)
    fitted = fitted_grid(scan.select(growth_views(len(scan))), scan.geometry, grid, tables.reconstruct)
    found += [Finding(Level.NOTE, "field-of-view", source.key, note, remedy=GROWN_REMEDY) for note in fitted.notes]
    return [*found, *check_scan(scan, grid, tables.check, where=source.key)]


def scan_facts(source: ScanInput, scan: Scan, pixels: PixelReport, grid: Volume) -> ScanFacts:
    """Facts about one scan as it was read."""
    geometry = scan.geometry
    pixel = geometry.pixel_at(grid.center)
    return ScanFacts(
        key=source.key,
        views=len(scan),
        rows=geometry.shape[0],
        columns=geometry.shape[1],
        dtype=str(source.radiographs.info()[1]),
        kind=source.kind,
        beam=geometry.beam,
        pixel_at_sample=pixel,
        magnification=float(geometry.pixel_sizes.mean() / pixel),
        air=float(np.median(scan.line_integrals[:, :, [0, -1]])),
        air_variation=_variation(scan.line_integrals[:, :, [0, -1]].mean(axis=2)),
        highest=float(scan.line_integrals.max()),
        pixels=pixels,
    )


def _variation(columns: Float) -> float:
    """Standard deviation along columns ``(views, rows)``, that is significant: of what even and odd rows share."""
    rows = columns.shape[1] // 8 * 8
    if rows == 0:
        return 0.0
    blocks = (columns - np.median(columns, axis=1, keepdims=True))[:, :rows].reshape(len(columns), -1, 4, 2)
    products = blocks.mean(axis=2, dtype=float).prod(axis=2)
    return float(np.sqrt(max(products.mean() - 3 * products.std() / np.sqrt(products.size), 0.0)))


def scan_findings(source: ScanInput, facts: ScanFacts, grid: Volume) -> tuple[Finding, ...]:
    """What is unusual about one scan as it was read."""
    key, found = source.key, list[Finding]()
    if abs(facts.air) > MAX_AIR_LINE_INTEGRAL:
        fact = f"the outermost columns have a line integral of {facts.air:.3f}"
        remedy = f"if they see only air, set {key}.air = {{ margin = 2 }}"
        if facts.air > 0 and facts.air_variation > MAX_AIR_VARIATION * facts.air:
            fact += ", which is not the same along them: probably they see the sample"
            remedy = "leave it if the sample is wider than the panel, else give flats of this scan"
        found.append(Finding(Level.NOTE, "inspect", key, fact, remedy=remedy))  # a level of the beam is fitted
    ratio = grid.voxel_size / facts.pixel_at_sample
    if not USUAL_VOXEL_PIXEL_RATIO[0] < ratio < USUAL_VOXEL_PIXEL_RATIO[1]:
        fact = f"a voxel is {ratio:.2f} times a pixel at the sample; near 1 is usual"
        found.append(_warning(key, fact, "check volume.voxel_size, and pixel_size and distances of the geometry"))
    if key != "reference" and facts.views < 2:
        found.append(_warning(key, "one view leaves the motion along its rays poorly determined", "take 2 or more"))
    if _overhangs(source, grid):
        fact = "the volume is wider than the panel sees; matter outside it is not modelled"
        found.append(_warning(key, fact, "give a smaller volume.shape, or ignore this if there is only air"))
    if key == "reference" and facts.views < facts.columns / 4:
        fact = f"{facts.views} views for {facts.columns} columns give a coarse volume"
        found.append(_warning(key, fact, f"{int(np.ceil(facts.columns * np.pi / 2))} would resolve all of it"))
    return tuple(found)


def _warning(where: str, fact: str, remedy: str) -> Finding:
    return Finding(Level.WARNING, "inspect", where, fact, remedy=remedy)


def _overhangs(source: ScanInput, grid: Volume) -> bool:
    """Whether the sides of the volume's upright cylinder project beyond the panel in some view."""
    columns = source.geometry.project_points(cylinder_circle(grid))[..., 1]
    width = source.geometry.shape[1]
    return bool(columns.min() < -MAX_PANEL_OVERHANG * width or columns.max() > (1 + MAX_PANEL_OVERHANG) * width)
