"""The log of runs, ``run.log`` beside the results: one entry a run, appended.

An entry names the command, versions, machine, inputs and settings; then come the stages with their times and the
findings, and last how the run ended.  It is begun only when all inputs were found usable, and a folder that cannot be
written to has none: the first result that is to be written there says so.
"""

from __future__ import annotations

import json
import logging
import os
import platform
import re
import shlex
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from importlib import metadata
from pathlib import Path

from grainmotion.errors import LOG_NOTE, GrainmotionError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.stacks import Stack
from grainmotion.io.volumes.record import VolumeFile
from grainmotion.workflow.versions import package_versions

RUN_LOG = "run.log"
SIZE_LINE = re.compile(r"  (?P<key>\S.*): (?P<size>\d+ views of \d+ x \d+ pixels|[\d x]+ voxels of \S+ mm)(, .*)?")
"""Line of the head of an entry that has the size of a scan or of the volume."""
PACKAGE_LOG = logging.getLogger("grainmotion")
STAGE_LOG = logging.getLogger("grainmotion.run")  # for the file alone: terminals have progress instead


class _RunFile(logging.FileHandler):
    """A log file that never ends a run: what cannot be written, as to a full disk, is left out."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802, a name of logging
        """Leave the record out."""


@contextmanager
def run_log(folder: Path, experiment: Experiment, inputs: Inputs, call: str) -> Iterator[None]:
    """Log what happens inside, after a head that describes the run; ``call`` is what was asked for."""
    before = PACKAGE_LOG.level
    handlers: list[logging.Handler] = []
    if not PACKAGE_LOG.hasHandlers() and logging.lastResort is not None:
        handlers.append(logging.lastResort)  # a file alone would keep warnings from the terminal
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / RUN_LOG).open("a", encoding="utf-8") as head:
            head.writelines(f"{line}\n" for line in _head(folder, experiment, inputs, call))
        file = _RunFile(folder / RUN_LOG, encoding="utf-8")
    except OSError:
        yield
        return
    file.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%Y-%m-%d %H:%M:%S"))
    handlers.append(file)
    for handler in handlers:
        PACKAGE_LOG.addHandler(handler)
    PACKAGE_LOG.setLevel(logging.INFO)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        yield
        STAGE_LOG.info("end: success, %s", _times(wall, cpu))
    except BaseException as error:
        error.add_note(f"{LOG_NOTE}{folder / RUN_LOG}")
        if isinstance(error, KeyboardInterrupt):
            STAGE_LOG.info("end: interrupted, %s", _times(wall, cpu))
        elif isinstance(error, GrainmotionError):
            STAGE_LOG.info("end: error, %s: %s", _times(wall, cpu), " ".join(str(error).split()))
        else:
            STAGE_LOG.info("end: fault of the program, %s", _times(wall, cpu), exc_info=True)
        raise
    finally:
        PACKAGE_LOG.setLevel(before)
        for handler in handlers:
            PACKAGE_LOG.removeHandler(handler)
        file.close()


@contextmanager
def timed(stage: str) -> Iterator[None]:
    """Log a stage that is done inside, with its times."""
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    STAGE_LOG.info("done: %s, %s", stage, _times(wall, cpu))


def _times(wall: float, cpu: float) -> str:
    return f"{time.perf_counter() - wall:.1f} s, {time.process_time() - cpu:.1f} s of CPU in this process"


def _head(folder: Path, experiment: Experiment, inputs: Inputs, call: str) -> Iterator[str]:
    """Lines of the description of a run."""
    yield f"==== {datetime.now().astimezone():%Y-%m-%d %H:%M:%S %z}, grainmotion {metadata.version('grainmotion')} ===="
    yield f"command: {shlex.join(sys.argv)}"
    yield f"call: {call}"
    yield f"experiment: {experiment.path.absolute()}"
    yield f"results: {folder.absolute()}"
    yield f"versions: {', '.join(f'{name} {number}' for name, number in package_versions().items())}"
    yield f"machine: {machine()}"
    yield "inputs:"
    for name, stack in input_stacks(inputs):
        files = len(set(stack.files))
        yield f"  {name}: {stack.spec}, {files} file{'s' * (files != 1)}"
    for scan in inputs.states if inputs.reference is None else (inputs.reference, *inputs.states):
        yield f"  {scan.key}: {size_of_scan(scan)}, {scan.kind}"
    yield f"  volume: {size_of_volume(inputs)}"
    yield "settings that differ from the defaults:"
    yield from (f"  {line}" for line in toml_lines(changed_settings(experiment)))


def size_of_scan(scan: ScanInput) -> str:
    """Views and pixels of a scan, as the log has them."""
    rows, columns = scan.geometry.shape
    return f"{len(scan.geometry)} views of {rows} x {columns} pixels"


def size_of_volume(inputs: Inputs) -> str:
    """Voxels of the reference volume, as the log has them."""
    return f"{' x '.join(map(str, inputs.grid.shape))} voxels of {inputs.grid.voxel_size:g} mm"


def input_stacks(inputs: Inputs) -> Iterator[tuple[str, Stack | VolumeFile]]:
    """The stacks of images by the key that names them."""
    for name, file in (("reference.volume", inputs.volume), ("reference.labels", inputs.labels)):
        if file is not None:
            yield name, file
    for scan in (inputs.reference, *inputs.states):
        if scan is None:
            continue
        for name, stack in (("radiographs", scan.radiographs), ("flats", scan.flats), ("darks", scan.darks)):
            if stack is not None:
                yield f"{scan.key}.{name}", stack


def changed_settings(experiment: Experiment) -> dict[str, object]:
    """The tables of the experiment file as resolved, without what has its default."""
    dumped: dict[str, object] = experiment.tables.model_dump(mode="json", exclude_defaults=True, exclude_none=True)
    return dumped


def toml_lines(tables: Mapping[str, object]) -> Iterator[str]:
    """Tables as TOML: one line a key, nested tables in one line."""
    for name, table in tables.items():
        for part in table if isinstance(table, list) else [table]:
            yield f"[[{name}]]" if isinstance(table, list) else f"[{name}]"
            if isinstance(part, dict):
                yield from (f"{key} = {_toml(value)}" for key, value in part.items())


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def machine() -> str:
    """Operating system, processor and number of cores."""
    return f"{platform.platform()}, {_processor()}, {len(_cores())} cores"


def _processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _cores() -> set[int]:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return set(os.sched_getaffinity(0))
    return set(range(os.cpu_count() or 1))
