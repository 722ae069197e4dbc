"""Estimates of what a run needs: time of each stage, memory, and bytes on the disk.

Times are those that the same stages took before, from ``run.log``, if scan and volume had the same sizes; else they
follow from voxels, pixels and views by constants that tell whole runs of 96³ to 512³ voxels on two cores of a server
to a sixth (`validation/benchmarks/large_scans.py`, which compares estimate and run).  Its grains are many and smooth,
the slowest to track; few large ones take less.  Of single stages an estimate may be off by a factor of about 3: shapes
of grains, large motions and other processors are not in it.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion.cluster.connection import LOCAL, ComputeConfig
from grainmotion.cluster.worker_limits import WorkerLimits
from grainmotion.cluster.worker_memory import ScanSize, memory_of_worker
from grainmotion.experiment.inspection import large_arrays_bytes, peak_memory
from grainmotion.workflow.dry_run import PlannedRun, PlannedStage
from grainmotion.workflow.log import RUN_LOG, SIZE_LINE, size_of_scan, size_of_volume
from grainmotion.workflow.memory import usable_memory

SECONDS_OF_PROGRAM = 3.9
"""CPU seconds of a run for loading libraries and compiled kernels."""
SECONDS_PER_CHECKED_PIXEL = 4e-7
"""Of reading and checking the radiographs of the reference scan."""
SECONDS_PER_RECONSTRUCTED_VOXEL, SECONDS_PER_RAY_VOXEL = 2e-7, 9e-10
"""Of the reconstruction: by voxels, and by those that the rays of all pixels cross."""
SECONDS_OF_CALIBRATION, CALIBRATION_SHARE, LONGEST_CALIBRATION = 1.5, 0.9, 24.0
"""Of the calibration: without any volume, for its part as a share of the reconstruction, and at most for that part, as
large scans are binned for it: 23.5 s in all of 512³ voxels, 25.8 s of 1000³."""
SECONDS_PER_SEGMENTED_VOXEL = 7e-7
SECONDS_PER_TRACKED_VOXEL = 1.3e-6
"""Of a voxel of the volume, for a state of `USUAL_VIEWS` views; how many grains it holds is not known before."""
USUAL_VIEWS, SHARE_WITHOUT_VIEWS = 4, 0.3
"""Views of a usual state, and the share of its time that does not depend on their number."""
SECONDS_PER_VOXEL_OF_REPORT = 1.5e-7
SECONDS_OF_ANY_STAGE = 0.4
SECONDS_OF_COMPILATION = 60.0
"""CPU seconds of compilation after an installation; later runs load what was compiled."""
BYTES_PER_STORED_VOXEL, BYTES_PER_EXPORTED_VOXEL = 4, 8
"""Volume and labels: compressed in the results, plain in files for other software."""
BYTES_PER_REPORT = 2e6
_LOGGED_TIME = re.compile(r" done: (\S+(?: \S+)*), [\d.]+ s, ([\d.]+) s of CPU")
_BEGIN_OF_RUN = "===="


@dataclass(frozen=True)
class StageEstimate:
    """CPU seconds of a stage, and whether it took them before, at the same sizes."""

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
    memory_of_worker : float
        Bytes at the peak of each worker, beside the process itself; 0 without workers.
    memory_usable : float
        Bytes that the process may use; 0 where workers compute.
    memory_in_files : float
        Bytes of large arrays that would be kept in files meanwhile; 0 if the memory suffices.
    disk : float
        Bytes that are written.
    disk_free : float
        Free bytes where the results go.
    start : float
        CPU seconds before the first stage: loading of libraries, reading and checks of radiographs.
    """

    stages: tuple[StageEstimate, ...]
    memory: float
    memory_of_worker: float
    memory_usable: float
    memory_in_files: float
    disk: float
    disk_free: float
    start: float

    @property
    def seconds(self) -> float:
        """CPU seconds of the run: of its start, and of all stages whose time is known."""
        return self.start + sum(stage.seconds or 0.0 for stage in self.stages)


def estimate(planned: PlannedRun, workplace: ComputeConfig = LOCAL, workers: Sequence[WorkerLimits] = ()) -> Needs:
    """What the planned stages of a run would need.

    Parameters
    ----------
    planned : PlannedRun
        Of `planned_run`.
    workplace : ComputeConfig, optional
        Processes that compute; by default this one.
    workers : sequence of WorkerLimits, optional
        Those of the workplace (`limits_of_workers`); a scheduler that has none is taken to have one.

    Returns
    -------
    Needs
        Times, memory and disk space.
    """
    before = logged_times(planned.folder / RUN_LOG, sizes(planned))
    stages = tuple(_of_stage(planned, stage, before) for stage in planned.planned)
    existing = next(path for path in (planned.folder, *planned.folder.absolute().parents) if path.exists())
    disk = sum(_bytes(planned, stage.name) for stage in planned.planned if not stage.kept)
    start = SECONDS_OF_PROGRAM + SECONDS_PER_CHECKED_PIXEL * _reference_pixels(planned)
    memory, usable = peak_memory(planned.inputs), 0.0 if workplace.is_cluster else usable_memory(workplace)
    files = large_arrays_bytes(planned.inputs) if 0 < usable < memory else 0.0
    count = len(workers) or workplace.workers or 1
    each = memory_of_worker(_scan_size(planned), count) if workplace.is_cluster else 0.0
    return Needs(stages, memory, each, usable, files, disk, shutil.disk_usage(existing).free, start)


def sizes(planned: PlannedRun) -> dict[str, str]:
    """Sizes of the volume and of each scan, as the log of a run has them."""
    scans = [source for _, source in planned.states]
    if planned.inputs.reference is not None:
        scans.append(planned.inputs.reference)
    return {"volume": size_of_volume(planned.inputs), **{scan.key: size_of_scan(scan) for scan in scans}}


def logged_times(log: Path, wanted: Mapping[str, str]) -> dict[str, float]:
    """CPU seconds of each stage when it was last done on a volume and scans of the wanted sizes, from the log of runs.

    A state's stages do not depend on the other states.
    """
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    found: dict[str, float] = {}
    logged: dict[str, str] = {}
    for line in lines:
        if line.startswith(_BEGIN_OF_RUN):
            logged = {}
        elif size := SIZE_LINE.fullmatch(line):
            logged[size["key"]] = size["size"]
        elif time := _LOGGED_TIME.search(line):
            keys = {"volume", "reference", f"states.{time[1].rpartition('/')[0]}"} & {*logged, *wanted}
            if all(logged.get(key) == wanted.get(key) for key in keys):
                found[time[1]] = float(time[2])
            else:
                found.pop(time[1], None)
    return found


def _of_stage(planned: PlannedRun, stage: PlannedStage, before: Mapping[str, float]) -> StageEstimate:
    if stage.kept:
        return StageEstimate(0.0)
    if stage.name in before:
        return StageEstimate(before[stage.name], from_log=True)
    like_it = [seconds for name, seconds in before.items() if name.endswith("/track") and stage.name.endswith("/track")]
    if like_it:  # other states of the same grains; the first of them may have waited for the compiler
        return StageEstimate(float(np.median(like_it)))
    return StageEstimate(_seconds(planned, stage.name))


def _seconds(planned: PlannedRun, name: str) -> float | None:
    """CPU seconds of a stage by the size of what it works on; None for exports whose time depends on the grains."""
    shape = planned.inputs.grid.shape
    voxels, ray = float(np.prod(shape)), float(np.mean(shape[1:]))
    reconstruction = SECONDS_PER_RECONSTRUCTED_VOXEL * voxels
    reconstruction += SECONDS_PER_RAY_VOXEL * _reference_pixels(planned) * ray
    if name == "reconstruct":
        return SECONDS_OF_ANY_STAGE + reconstruction
    if name == "calibrate":
        return SECONDS_OF_CALIBRATION + min(CALIBRATION_SHARE * reconstruction, LONGEST_CALIBRATION)
    if name == "segment":
        return SECONDS_OF_ANY_STAGE + SECONDS_PER_SEGMENTED_VOXEL * voxels
    if name.endswith("/track"):
        views = _views(planned, name.removesuffix("/track"))
        share = SHARE_WITHOUT_VIEWS + (1 - SHARE_WITHOUT_VIEWS) * views / USUAL_VIEWS
        return SECONDS_OF_ANY_STAGE + SECONDS_PER_TRACKED_VOXEL * share * voxels
    if name == "report":
        return SECONDS_OF_ANY_STAGE + SECONDS_PER_VOXEL_OF_REPORT * voxels
    return 0.0 if name.rpartition("/")[2] in ("residuals", "bodies", "h5", "csv") else None


def _bytes(planned: PlannedRun, name: str) -> float:
    """Bytes that a stage writes."""
    voxels = float(np.prod(planned.inputs.grid.shape))
    state, _, what = name.rpartition("/")
    if name == "segment":
        return BYTES_PER_STORED_VOXEL * voxels
    if what.startswith(("rebuilt", "vtk", "tiff", "ome-zarr", "spam")):
        return BYTES_PER_EXPORTED_VOXEL * voxels
    if what == "residuals":
        return 4.0 * _pixels(planned, state)
    return BYTES_PER_REPORT if name == "report" else 0.0


def _reference_pixels(planned: PlannedRun) -> float:
    """Pixels of all radiographs of the reference scan; 0 where a volume is given instead."""
    reference = planned.inputs.reference
    return 0.0 if reference is None else len(reference.geometry) * float(np.prod(reference.geometry.shape))


def _scan_size(planned: PlannedRun) -> ScanSize:
    """The size of the volume and of its scan."""
    reference = planned.inputs.reference
    views, panel = (0, (0, 0)) if reference is None else (len(reference.geometry), reference.geometry.shape)
    return ScanSize(planned.inputs.grid.shape, views, *panel)


def _views(planned: PlannedRun, state: str) -> int:
    return _shape(planned, state)[0]


def _pixels(planned: PlannedRun, state: str) -> float:
    return float(np.prod(_shape(planned, state)))


def _shape(planned: PlannedRun, state: str) -> Sequence[int]:
    """Views, rows and columns of a state."""
    geometry = next(source.geometry for table, source in planned.states if table.name == state)
    return (len(geometry), *geometry.shape)
