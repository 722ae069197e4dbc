"""Inputs of an experiment: files are located, their shapes and geometry checked, before any work begins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from grainmotion._typing import Float
from grainmotion.backends.device import backend_of
from grainmotion.diagnosis.label_shapes import shape_hint
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.config_errors import together
from grainmotion.experiment.given_grid import given_grid, named_volume, other_size
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import ScanTable, StateTable
from grainmotion.io.motions_csv import read_motions
from grainmotion.io.spam import read_ddic_tsv
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.io.volumes.zarr_reader import import_zarr
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume

MAX_VOXEL_PIXEL_RATIO = 20.0  # of a voxel and a pixel at the sample, either way; more is a mistake of units
MIN_VIEWS_FOR_CONTRAST = 30  # fewer do not average the noise enough
MAX_FOOTPRINT_PANEL_RATIO = 10.0  # columns of the volume's footprint over those of the panel


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of an experiment."""

    reference: ScanInput | None  # the full scan; None if the volume is given
    states: tuple[ScanInput, ...]  # in the order of the file
    starts: tuple[Motions | None, ...]  # initial motions of each state that names a file of them
    grid: Volume  # zeros on the grid of the reference volume
    volume: VolumeFile | None = None  # a reference volume made by other software, 1/mm
    labels: VolumeFile | None = None  # and labels
    volume_scan: ScanInput | None = None  # radiographs of the given volume, with which it is only compared


def find_inputs(experiment: Experiment) -> Inputs:
    """Locate all files of an experiment and check headers, shapes and geometry; pixels are not read.

    The first file that is missing or damaged, or that contradicts another or a key, raises an `InputError`.
    """
    tables, folder = experiment.tables, experiment.folder
    for device in (tables.reconstruct.device, tables.track.device):
        backend_of(device)  # raises if the device is missing
    if "ome-zarr" in tables.output.exports or (tables.output.rebuild and tables.output.volumes == "ome-zarr"):
        import_zarr("output")  # raises if it is missing, before hours of work
    volume = named_volume("reference.volume", tables.reference.volume, folder)
    labels = named_volume("reference.labels", tables.reference.labels, folder)
    calibrates = tables.calibrate.geometry not in (False, "auto") or tables.calibrate.hardening
    if volume is not None and calibrates:
        fact = "the reference is a volume, and calibration needs its full scan"
        raise InputError("calibrate", fact, "leave [calibrate] out, or reference.volume")
    scans, errors = _find_scans(experiment, given=volume is not None)
    if errors:
        raise together(errors)
    reference = scans.get("reference")
    grid = _grid(experiment, reference, volume)
    if labels is not None and labels.shape != grid.shape:
        fact = f"labels of {labels.shape} voxels, but the volume has {grid.shape}{shape_hint(labels.shape, grid.shape)}"
        raise InputError(f"{labels.spec} (reference.labels)", fact, "give labels of that volume, z y x")
    states = tuple(scans[f"states.{t.name}"] for t in tables.states)
    for scan in (reference, *states):
        if scan is not None:
            try:
                check_plausible(scan.key, scan.geometry, grid)
            except InputError as error:
                told = "" if volume is None else other_size(volume, grid)
                raise InputError(error.where, error.fact + told, error.remedy) from error
    starts = tuple(start_in_file(folder, t, grid) for t in tables.states)
    if volume is not None:
        return Inputs(None, states, starts, grid, volume, labels, reference)
    return Inputs(reference, states, starts, grid, None, labels)


def _find_scans(experiment: Experiment, *, given: bool) -> tuple[dict[str, ScanInput], list[InputError]]:
    """The scans by their keys, and the errors of those that cannot be used.

    The reference may be left out beside a given volume.  What a state has from it is not reported again.
    """
    tables = experiment.tables
    wanted: dict[str, ScanTable] = {f"states.{table.name}": table for table in tables.states}
    if not given or tables.reference.radiographs is not None:
        wanted = {"reference": tables.reference, **wanted}
    scans, errors = dict[str, ScanInput](), list[InputError]()
    for key, table in wanted.items():
        try:
            scans[key] = find_scan(key, table, tables.reference, experiment.folder)
        except InputError as error:
            if (error.fact, error.remedy) not in [(e.fact, e.remedy) for e in errors if "reference." in e.where]:
                errors.append(error)
    return scans, errors


def start_in_file(folder: Path, table: StateTable, grid: Volume) -> Motions | None:
    """The motions in the file that ``initial`` names; None if it names a state."""
    initial = table.initial
    if table.initial_about is not None and not initial.endswith(".tsv"):
        fact = f"'{table.initial_about}', but initial = \"{initial}\" is no file of spam (.tsv)"
        raise InputError(f"states.{table.name}.initial_about", fact, "leave it out")
    if initial in ("previous", "reference"):
        return None
    try:
        if initial.endswith(".tsv"):
            return read_ddic_tsv(folder / initial, grid, about=table.initial_about)
        return read_motions(folder / initial)
    except InputError as error:
        raise InputError(f"{error.where} (states.{table.name}.initial)", error.fact, error.remedy) from error


def check_plausible(key: str, geometry: Geometry, grid: Volume) -> None:
    """Refuse a geometry in other units than the volume's, or a panel that its upright cylinder never projects on."""
    units = "check that all lengths share one unit, mm: volume, pixel size and distances"
    circle = cylinder_circle(grid)
    top = np.array([0.0, 0.0, grid.voxel_size * grid.shape[0] / 2])
    points = np.concatenate([circle + top, circle - top])
    ratio = grid.voxel_size / geometry.pixel_at(grid.center)
    if ratio > 0 and not 1 / MAX_VOXEL_PIXEL_RATIO < ratio < MAX_VOXEL_PIXEL_RATIO:
        fact = f"a voxel of {grid.voxel_size:.4g} mm is {ratio:.3g} times a pixel at the sample"
        raise InputError(f"{key}.geometry and volume.voxel_size", f"{fact}: wrong units?", units)
    pixels = geometry.project_points(points)
    if np.isnan(pixels).any():
        view = int(np.argwhere(np.isnan(pixels))[0, 0])
        raise InputError(f"{key}.geometry, view {view}", "the source lies in or behind the volume", units)
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    extent = high - low
    widest = float(extent[:, 1].max())
    if widest > MAX_FOOTPRINT_PANEL_RATIO * geometry.shape[1]:
        fact = f"the volume's footprint is {widest:.0f} pixels wide, the panel {geometry.shape[1]}"
        raise InputError(f"{key}.geometry and volume", f"{fact}: the sample does not fit the field of view", units)
    if float(extent.max()) < 2:
        raise InputError(f"{key}.geometry and volume", "the volume's footprint is less than 2 pixels wide", units)
    panel = np.array(geometry.shape) - 0.5
    off = (high < -0.5).any(axis=1) | (low > panel).any(axis=1)
    if off.any():
        view = int(np.argmax(off))
        row, column = pixels[view].mean(axis=0)
        fact = f"the sample never shadows the panel: its centre falls on row {row:.0f}, column {column:.0f}"
        remedy = f"check source, panel centre, u and v; the panel has {geometry.shape} rows and columns"
        raise InputError(f"{key}.geometry, view {view}", fact, remedy)


def cylinder_circle(grid: Volume) -> Float:
    """Points ``(24, 3)`` of the circle at half the height of the upright cylinder in a volume's box, mm."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    return circle * grid.voxel_size * min(grid.shape[1:]) / 2 + grid.center


def check_contrast(where: str, scan: Scan) -> None:
    """Refuse a full scan whose mean radiograph is flat to within its noise.

    The noise is estimated from the difference between the means of every second view and of the others.
    """
    if len(scan) < MIN_VIEWS_FOR_CONTRAST:
        return
    halves = [scan.line_integrals[start::2].mean(axis=0, dtype=float) for start in (0, 1)]
    first, second = (ndimage.uniform_filter(h, 5) for h in halves)
    mean, noise = (first + second) / 2, float((first - second).std()) / 2
    contrast = float(mean.max() - mean.min())
    if contrast < max(12 * noise, 1e-3):
        fact = f"no grains found: the mean radiograph varies by {contrast:.2g}, which is no more than noise"
        raise InputError(where, fact, "check that these are the radiographs, and not flats")


def _grid(experiment: Experiment, scan: ScanInput | None, volume: VolumeFile | None) -> Volume:
    """Zeros on the grid of ``[volume]``; keys that it leaves out follow from the given volume or the panel."""
    table = experiment.tables.volume
    if volume is not None:
        return given_grid(table, volume)
    shape, voxel_size = table.shape, table.voxel_size
    if scan is not None:
        rows, columns = scan.geometry.shape
        shape = shape or (rows, columns, columns)
        voxel_size = voxel_size or scan.geometry.pixel_at(table.center)
    assert shape is not None
    assert voxel_size is not None
    if min(shape) < 1:
        raise InputError("volume.shape", f"must be at least 1 voxel, got {list(shape)}", "give z, y, x")
    return Volume.zeros(shape, voxel_size, table.center)
