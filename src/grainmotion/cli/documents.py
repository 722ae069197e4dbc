"""The JSON documents of ``--json``: what each command tells, declared once; docs/command-line.md is made from these.

A field's meaning stands in its annotation.  Lengths are in mm, angles in degrees, paths absolute.  Fields may be added
in any version; if one is renamed, removed or changes its meaning, `SCHEMA` goes up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

SCHEMA = 1


@dataclass(frozen=True)
class GrainToLookAt:
    """A grain whose motion is not wholly a result to use."""

    label: Annotated[int, "its label"]
    status: Annotated[str, "its status"]
    reason: Annotated[str, "why, and what to do"]


@dataclass(frozen=True)
class StateResult:
    """How the tracking of one state went."""

    name: Annotated[str, "its name"]
    grains: Annotated[int, "grains of the reference"]
    converged: Annotated[int, "grains whose translation and rotation are results to use"]
    translations: Annotated[int, "translations that are results to use"]
    rotations: Annotated[int, "rotations that are results to use"]
    statuses: Annotated[dict[str, int], "how many grains have each status"]
    median_translation: Annotated[float | None, "median length of the translations to use, mm"]
    median_rotation: Annotated[float | None, "median angle of the rotations to use, degrees"]
    look_at: Annotated[list[GrainToLookAt], "the grains that need a look"]
    remarks: Annotated[list[str], "sentences about bodies, a liquid, and grains that appeared or broke"]
    files: Annotated[list[str], "files of this state"]


@dataclass(frozen=True)
class RunOutcome:
    """Of `run`, `reconstruct`, `segment`, `track`, `report` and `export`."""

    folder: Annotated[str, "folder of the results"]
    report: Annotated[str | None, "the report, if it was wanted"]
    log: Annotated[str, "the log of runs"]
    done: Annotated[list[str], "stages that this run did, in order"]
    kept: Annotated[list[str], "stages that an earlier run had done"]
    states: Annotated[list[StateResult], "the states, in loading order"]
    files: Annotated[list[str], "files of the reference and of all states together"]


@dataclass(frozen=True)
class StagePlan:
    """A stage of a run, as `--dry-run` tells it."""

    name: Annotated[str, "its name, as in run.log"]
    kept: Annotated[bool, "whether an earlier run has done it and nothing changed"]
    why: Annotated[str, "why it would be done; empty if it is kept"]
    seconds: Annotated[float | None, "estimate of its CPU time, s; null if it is not known"]
    from_log: Annotated[bool, "whether that is the time that it took before"]


@dataclass(frozen=True)
class WorkerPlan:
    """A worker of a run, as `--dry-run` tells it."""

    address: Annotated[str, "where it is reached; empty for one that the run would start on this machine"]
    threads: Annotated[int, "threads that it uses"]
    memory_limit: Annotated[int, "memory that it may use, bytes; 0 without a limit"]
    enough: Annotated[bool, "whether that is what it needs"]


@dataclass(frozen=True)
class DryRunOutcome:
    """Of the same commands with `--dry-run`, which write nothing."""

    folder: Annotated[str, "folder of the results"]
    stages: Annotated[list[StagePlan], "the stages in order"]
    seconds: Annotated[float, "estimate of the CPU time of all that would be done, s"]
    start: Annotated[float, "its part before the first stage, to load libraries and to read and check radiographs, s"]
    memory: Annotated[int, "estimate of the memory at the peak, bytes"]
    memory_of_worker: Annotated[int, "the same of each worker, beside the command itself, bytes; 0 without workers"]
    workers: Annotated[list[WorkerPlan], "the workers, for a scheduler those that it has now; empty without workers"]
    memory_usable: Annotated[int, "memory that may be used, bytes; 0 on workers"]
    memory_in_files: Annotated[int, "bytes that would be kept in files meanwhile, as the memory is short; else 0"]
    disk: Annotated[int, "estimate of what would be written, bytes"]
    disk_free: Annotated[int, "free bytes where the results go"]
    notes: Annotated[list[str], "what the estimates leave open"]


@dataclass(frozen=True)
class WatchOutcome:
    """Of `watch`."""

    folder: Annotated[str, "folder of the results"]
    page: Annotated[str, "the live page"]
    ended: Annotated[str, "why it ended"]
    states: Annotated[list[StateResult], "the states that were tracked"]


@dataclass(frozen=True)
class Facts:
    """Facts under a title."""

    title: Annotated[str, "of what"]
    rows: Annotated[list[tuple[str, str]], "name and value of each"]


@dataclass(frozen=True)
class Line:
    """Something else that was told."""

    key: Annotated[str, "what it is about: `picture`, `next`, `scan`, `to fill in`, `not usable`, …"]
    text: Annotated[str, "what was told"]


@dataclass(frozen=True)
class ScanOutcome:
    """A scan of an experiment."""

    key: Annotated[str, "`reference` or `states.NAME`"]
    views: Annotated[int, "radiographs"]
    rows: Annotated[int, "rows of each"]
    columns: Annotated[int, "columns of each"]
    dtype: Annotated[str, "number type of the files"]
    kind: Annotated[str, "what the pixels are"]
    beam: Annotated[str, "`cone` or `parallel`"]
    pixel_at_sample: Annotated[float, "pixel size over the magnification, mm"]
    magnification: Annotated[float, "at the centre of the volume"]
    masked_pixels: Annotated[int, "pixels that are left out"]


@dataclass(frozen=True)
class InspectOutcome:
    """Of `inspect` and `init`."""

    path: Annotated[str, "what was looked at, or the experiment file that was written"]
    facts: Annotated[list[Facts], "facts of files, volumes and scans"] = field(default_factory=list)
    lines: Annotated[list[Line], "all else"] = field(default_factory=list)
    scans: Annotated[list[ScanOutcome], "scans of an experiment file"] = field(default_factory=list)
    volume_shape: Annotated[tuple[int, int, int] | None, "voxels along z, y, x, of an experiment file"] = None
    voxel_size: Annotated[float | None, "mm, of an experiment file"] = None
    memory: Annotated[int | None, "estimate of the memory of a run at its peak, bytes"] = None


@dataclass(frozen=True)
class ViewSetOutcome:
    """A set of views of a plan."""

    views: Annotated[int, "number of views"]
    kind: Annotated[str, "how they were chosen"]
    angles: Annotated[list[float], "angles, degrees"]
    sd_translation: Annotated[float, "median predicted standard deviation of a component, mm"]
    sd_rotation: Annotated[float, "the same of a rotation, degrees"]
    worst_sd_translation: Annotated[float, "the worst of any grain, voxels"]
    worst_sd_rotation: Annotated[float, "the worst of any grain, degrees"]
    captured: Annotated[list[tuple[float, float]], "motions that tracking captures: grain diameters, degrees"]


@dataclass(frozen=True)
class ViewOutcome:
    """Of `view`."""

    folder: Annotated[str, "folder of the results that were shown"]


@dataclass(frozen=True)
class PlanOutcome:
    """Of `plan`."""

    folder: Annotated[str, "folder of plan.csv, angles.csv and plan.png"]
    grains: Annotated[int, "grains of the reference"]
    sets: Annotated[list[ViewSetOutcome], "the sets of views"]


@dataclass(frozen=True)
class ComparisonOutcome:
    """Errors of a state of the demo against its true motions."""

    state: Annotated[str, "its name"]
    grains: Annotated[int, "grains"]
    failures: Annotated[int, "grains that failed"]
    translation_error: Annotated[float, "root mean square over grains and components, voxels"]
    rotation_error: Annotated[float, "the same, degrees"]


@dataclass(frozen=True)
class DemoOutcome:
    """Of `demo`."""

    experiment: Annotated[str, "the simulated experiment's file"]
    run: Annotated[RunOutcome, "as of `run`"]
    comparisons: Annotated[list[ComparisonOutcome], "each state against the truth"]


@dataclass(frozen=True)
class SimulateOutcome:
    """Of `simulate`."""

    experiment: Annotated[str, "the experiment's file"]


@dataclass(frozen=True)
class VersionOutcome:
    """Of `version`."""

    version: Annotated[str, "of grainmotion"]
    python_version: Annotated[str, "of Python"]
    packages: Annotated[dict[str, str], "of the libraries that compute"]


@dataclass(frozen=True)
class FindingOutcome:
    """What a check noticed; docs/troubleshooting.md has a section on each check."""

    level: Annotated[str, "`error`, `warning` or `note`"]
    check: Annotated[str, "name of the check"]
    where: Annotated[str, "file, key, state or grain"]
    fact: Annotated[str, "what is wrong"]
    evidence: Annotated[str, "the numbers behind it"]
    remedy: Annotated[str, "what to do"]
    fix: Annotated[str, "name of the fix that `--try-fixes` applies, if there is one"]


@dataclass(frozen=True)
class ErrorOutcome:
    """Why a command ended before its end."""

    kind: Annotated[str, "`usage`, `input`, `device`, `memory`, `interrupted` or `fault`"]
    where: Annotated[str, "file, key or option at fault"]
    fact: Annotated[str, "what is wrong"]
    remedy: Annotated[str, "what to do"]
    log: Annotated[str | None, "log file that tells more"]


Document = (
    RunOutcome | DryRunOutcome | WatchOutcome | InspectOutcome | ViewOutcome | PlanOutcome | DemoOutcome
    | SimulateOutcome | VersionOutcome
)  # fmt: skip


@dataclass(frozen=True)
class Envelope:
    """The document: the same outer part for every command."""

    schema: Annotated[int, f"version of this schema, {SCHEMA}"]
    grainmotion: Annotated[str, "version of the program"]
    command: Annotated[str, "the command, as `run` or `export dem`"]
    exit_code: Annotated[int, "the exit code of the process"]
    reason: Annotated[str, "why the exit code is not 0; else empty"]
    error: Annotated[ErrorOutcome | None, "what ended the command before its end"]
    findings: Annotated[list[FindingOutcome], "what checks noticed, the worst first"]
    result: Annotated[Document | None, "what the command tells; null after an error"]
