"""Inspection: what an experiment's data are, before any work: shapes, pixels, memory, warnings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.flat_field import PixelReport

MASKED_SHARE = 0.01  # more masked pixels than this deserve a warning
AIR_LIMIT = 0.02  # a median line integral of the outermost columns beyond this, too
BYTES_A_VOXEL = 30  # float volume, labels, distances and the grown labels at the peak of the segmentation


@dataclass(frozen=True)
class ScanFacts:
    """What is known of one scan.

    Attributes
    ----------
    key : str
    views, rows, columns : int
    dtype, kind, beam : str
    pixel_at_sample : float
        Pixel carried back to the volume's centre, mm.
    magnification : float
    air : float
        Median line integral of the two outermost columns.
    highest : float
        Highest line integral.
    pixels : PixelReport
    """

    key: str
    views: int
    rows: int
    columns: int
    dtype: str
    kind: str
    beam: str
    pixel_at_sample: float
    magnification: float
    air: float
    highest: float
    pixels: PixelReport


@dataclass(frozen=True)
class Inspection:
    """What is known of an experiment.

    Attributes
    ----------
    scans : tuple of ScanFacts
        The reference first, then the states.
    volume_shape : (int, int, int)
    voxel_size : float
        mm.
    memory : float
        Estimate of the peak, bytes.
    warnings : tuple of str
        What may be meant otherwise, with a remedy.
    """

    scans: tuple[ScanFacts, ...]
    volume_shape: tuple[int, int, int]
    voxel_size: float
    memory: float
    warnings: tuple[str, ...]


def inspect_inputs(inputs: Inputs) -> Inspection:
    """Read all radiographs once and tell what they are; errors are those of a run."""
    facts: list[ScanFacts] = []
    warnings: list[str] = []
    for source in (inputs.reference, *inputs.states):
        if source is None:
            continue
        scan, pixels = source.read()
        facts.append(_facts(source, scan, pixels, inputs.grid))
        warnings += _scan_warnings(source, facts[-1], inputs.grid)
    reference = inputs.reference
    if reference is not None and facts[0].views < facts[0].columns / 4:
        enough = int(np.ceil(facts[0].columns * np.pi / 2))
        warnings.append(
            f"reference: {facts[0].views} views for {facts[0].columns} columns give a coarse volume; "
            f"{enough} would resolve all of it"
        )
    if not inputs.states:
        warnings.append("no states: add a [[states]] table for each later state")
    grid = inputs.grid
    memory = BYTES_A_VOXEL * float(np.prod(grid.shape))
    if reference is not None:
        memory = max(memory, 8.0 * np.prod(grid.shape) + 9.0 * facts[0].views * facts[0].rows * facts[0].columns)
    return Inspection(tuple(facts), grid.shape, grid.voxel_size, memory, tuple(warnings))


def _facts(source: ScanInput, scan: Scan, pixels: PixelReport, grid: Volume) -> ScanFacts:
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
        highest=float(scan.line_integrals.max()),
        pixels=pixels,
    )


def _scan_warnings(source: ScanInput, facts: ScanFacts, grid: Volume) -> list[str]:
    warnings = []
    if facts.pixels.bad > MASKED_SHARE * facts.pixels.total:
        warnings.append(f"{facts.key}: {facts.pixels}; check flats, darks and exposure")
    if abs(facts.air) > AIR_LIMIT:
        warnings.append(
            f"{facts.key}: the outermost columns have a line integral of {facts.air:.3f}; "
            f"if they see only air, set {facts.key}.air = {{ margin = 2 }}"
        )
    ratio = grid.voxel_size / facts.pixel_at_sample
    if not 0.4 < ratio < 2.5:
        warnings.append(f"{facts.key}: a voxel is {ratio:.2f} times a pixel at the sample; near 1 is usual")
    if facts.key != "reference" and facts.views < 2:
        warnings.append(f"{facts.key}: one view leaves the motion along its rays poorly determined; take 2 or more")
    if _cut(source, grid):
        warnings.append(f"{facts.key}: the volume is wider than the panel sees; matter outside it is not modelled")
    return warnings


def _cut(source: ScanInput, grid: Volume) -> bool:
    """Whether the sides of the volume's upright cylinder fall off the panel in some view, by over a tenth."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    radius = grid.voxel_size * min(grid.shape[1:]) / 2
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1) * radius + grid.center
    columns = source.geometry.project_points(ring)[..., 1]
    width = source.geometry.shape[1]
    return bool((columns.min() < -0.1 * width) or (columns.max() > 1.1 * width))
