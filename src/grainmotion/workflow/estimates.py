"""Estimates of what a run needs: time of each stage, memory, and bytes on the disk.

Times are those that the same stages took before, from ``run.log``; else they follow from voxels, pixels and views by
the times that the benchmarks measured on two cores of a server (``validation/benchmarks``).  They hold within a factor
of about 3: shapes of grains, large motions and other processors are not in them.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion.experiment.inspection import peak_memory
from grainmotion.workflow.dry_run import PlannedRun, PlannedStage
from grainmotion.workflow.log import RUN_LOG

SECONDS_PER_RAY_VOXEL = 5e-9
"""CPU seconds of the default reconstruction: 16 s for 352 views of 280 x 180 pixels and 180 voxels along a ray."""
CALIBRATION_SHARE = 1.5
"""Time of the calibration over that of the reconstruction."""
SECONDS_PER_SEGMENTED_VOXEL = 1.4e-6
"""13 s for 280 x 180 x 180 voxels."""
SECONDS_PER_TRACKED_VOXEL = 7e-7
"""Of a voxel of grains in one view: 2 s for 15 grains of 48,000 voxels in 4 views."""
GRAIN_SHARE = 0.3
"""Share of the volume's voxels that belong to grains, before they are known."""
SECONDS_OF_ANY_STAGE = 1.0
SECONDS_OF_COMPILATION = 60.0
"""CPU seconds of compilation after an installation; later runs load what was compiled."""
BYTES_PER_STORED_VOXEL = 8  # volume and labels
BYTES_PER_REPORT = 5e6
_LOGGED_TIME = re.compile(r" done: (\S+(?: \S+)*), [\d.]+ s, ([\d.]+) s of CPU")


@dataclass(frozen=True)
class StageEstimate:
    """CPU seconds of a stage, and whether it took them before."""

    seconds: float | None
    from_log: bool = False


@dataclass(frozen=True)
class Needs:
    """What a run would need.

    Attributes
    ----------
    stages : tuple of StageEstimate
        Of each planned stage; 0 s for those that are kept.
    memory : float
        Bytes at the peak.
    disk : float
        Bytes that are written.
    disk_free : float
        Free bytes where the results go.
    """

    stages: tuple[StageEstimate, ...]
    memory: float
    disk: float
    disk_free: float

    @property
    def seconds(self) -> float:
        """CPU seconds of all stages whose time is known."""
        return sum(stage.seconds or 0.0 for stage in self.stages)


def estimate(planned: PlannedRun) -> Needs:
    """What the planned stages of a run would need.

    Parameters
    ----------
    planned : PlannedRun
        Of `planned_run`.

    Returns
    -------
    Needs
        Times, memory and disk space.
    """
    before = logged_times(planned.folder / RUN_LOG)
    stages = tuple(_of_stage(planned, stage, before) for stage in planned.planned)
    existing = next(path for path in (planned.folder, *planned.folder.absolute().parents) if path.exists())
    disk = sum(_bytes(planned, stage.name) for stage in planned.planned if not stage.kept)
    return Needs(stages, peak_memory(planned.inputs), disk, shutil.disk_usage(existing).free)


def logged_times(log: Path) -> dict[str, float]:
    """CPU seconds of each stage when it was last done, from the log of runs."""
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    found = (_LOGGED_TIME.search(line) for line in lines)
    return {match[1]: float(match[2]) for match in found if match is not None}


def _of_stage(planned: PlannedRun, stage: PlannedStage, before: dict[str, float]) -> StageEstimate:
    if stage.kept:
        return StageEstimate(0.0)
    if stage.name in before:
        return StageEstimate(before[stage.name], from_log=True)
    seconds = _seconds(planned, stage.name)
    return StageEstimate(None if seconds is None else SECONDS_OF_ANY_STAGE + seconds)


def _seconds(planned: PlannedRun, name: str) -> float | None:
    """CPU seconds of a stage by the size of what it works on; None for exports whose time depends on the grains."""
    inputs = planned.inputs
    voxels, reference = float(np.prod(inputs.grid.shape)), inputs.reference
    rays = 0.0 if reference is None else len(reference.geometry) * float(np.prod(reference.geometry.shape))
    reconstruction = SECONDS_PER_RAY_VOXEL * rays * float(np.mean(inputs.grid.shape[1:]))
    if name == "reconstruct":
        return reconstruction
    if name == "calibrate":
        return CALIBRATION_SHARE * reconstruction
    if name == "segment":
        return SECONDS_PER_SEGMENTED_VOXEL * voxels
    if name.endswith("/track"):
        views = _views(planned, name.removesuffix("/track"))
        return SECONDS_PER_TRACKED_VOXEL * GRAIN_SHARE * voxels * views
    if name == "report" or name.rpartition("/")[2] in ("residuals", "bodies", "h5", "csv"):
        return 0.0
    return None


def _bytes(planned: PlannedRun, name: str) -> float:
    """Bytes that a stage writes."""
    stored = BYTES_PER_STORED_VOXEL * float(np.prod(planned.inputs.grid.shape))
    state, _, what = name.rpartition("/")
    if name == "segment" or what.startswith(("rebuilt", "vtk", "tiff", "ome-zarr", "spam")):
        return stored
    if what == "residuals":
        return 4.0 * _pixels(planned, state)
    return BYTES_PER_REPORT if name == "report" else 0.0


def _views(planned: PlannedRun, state: str) -> int:
    return _shape(planned, state)[0]


def _pixels(planned: PlannedRun, state: str) -> float:
    return float(np.prod(_shape(planned, state)))


def _shape(planned: PlannedRun, state: str) -> Sequence[int]:
    """Views, rows and columns of a state."""
    geometry = next(source.geometry for table, source in planned.states if table.name == state)
    return (len(geometry), *geometry.shape)
