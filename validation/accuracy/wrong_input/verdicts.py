"""Verdict: what a run said about one input, and how far its results are from the truth."""

from __future__ import annotations

import json
import logging
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.model.motions import Motions, Status
from grainmotion.workflow.log import PACKAGE_LOG
from grainmotion.workflow.run import run
from validation.accuracy import outcomes

WRONG_VOXELS, WRONG_DEG, WRONG_SDS = 0.1, 1.5, 5.0
"""A grain that converged is wrong if a component is off by more than this and by more than so many own sd.

The bounds are tighter than those of `outcomes`, as several of the inputs were found to give errors of 0.1 to 0.3 voxel.
Sound scans of these samples leave up to 0.06 voxel and 1.2 degrees.
"""


@dataclass(frozen=True)
class Verdict:
    """What became of one input.

    Attributes
    ----------
    lines : list of str
        The error that stopped it, findings with their fix in braces, and sentences of grains that are not converged,
        each after its level.
    stopped : bool
        Whether nothing was tracked.
    converged, wrong, absent, extra : int
        Grains that converged; those of them that are wrong; true grains that are in no table; grains that converged
        and are no true ones.
    worst : (float, float)
        Largest error of a grain that converged: voxels, degrees.
    cpu : float
        Seconds.
    source : str
        Digest of the package that was run.
    """

    lines: list[str]
    stopped: bool
    converged: int
    wrong: int
    absent: int
    extra: int
    worst: tuple[float, float]
    cpu: float
    source: str = ""

    @property
    def told(self) -> list[str]:
        """Errors and warnings."""
        return [line for line in self.lines if line.startswith(("error", "warning"))]

    @property
    def silent(self) -> bool:
        """Whether something is wrong, converged or left out, without any word."""
        return not self.told and self.wrong + self.absent + self.extra > 0

    @property
    def right(self) -> bool:
        """Whether all grains were found and none that converged is wrong."""
        return not self.stopped and self.wrong + self.absent + self.extra == 0 and self.converged > 0


def judged(path: Path, truth: Motions, voxel_size: float) -> Verdict:
    """Run an experiment up to its motions, as `grainmotion run` does."""
    start, folder, logged = time.process_time(), path.parent / "results", _Lines()
    PACKAGE_LOG.addHandler(logged)
    try:
        result = run(read_experiment(path), out=folder, until="track")
    except InputError as error:
        lines = [f"error: {error}{_fixes(folder, str(error))}", *logged.lines]
        return Verdict(lines, True, 0, 0, 0, 0, (0.0, 0.0), time.process_time() - start)
    finally:
        PACKAGE_LOG.removeHandler(logged)
    motions = next(iter(result.motions.values()))
    lines = [f.line + (f" {{{f.fix}}}" if f.fix else "") for f in result.findings]
    lines += [f"grain: {s}: {reason}" for s, reason in Counter(_reasons(motions))]
    outcome = outcomes.outcome(motions, truth, voxel_size, 0.0)
    errors, sds = np.array(outcome.errors), np.array(outcome.sds)
    good = np.array(outcome.statuses) == Status.CONVERGED.value
    limits = np.maximum(WRONG_SDS * sds, np.repeat([WRONG_VOXELS, WRONG_DEG], 3))
    wrong = int((good & (np.abs(errors) > limits).any(axis=1)).sum())
    matched = int((np.array(outcome.statuses) != outcomes.MISSING).sum())
    converged = int((motions.statuses == Status.CONVERGED.value).sum())
    refused = bool((motions.statuses == Status.NOT_FITTED.value).all())
    absent = 0 if refused else len(truth) - matched
    worst = np.abs(errors[good]) if good.any() else np.zeros((1, 6))
    seconds = time.process_time() - start
    largest = (float(worst[:, :3].max()), float(worst[:, 3:].max()))
    return Verdict(lines, refused, converged, wrong, absent, converged - int(good.sum()), largest, seconds)


def _reasons(motions: Motions) -> list[tuple[str, str]]:
    bad = motions.statuses != Status.CONVERGED.value
    return [(str(s), r) for s, r, b in zip(motions.statuses, motions.reasons, bad, strict=True) if b]


class _Lines(logging.Handler):
    """Findings as they are logged."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line."""
        self.lines.append(record.getMessage())


def _fixes(folder: Path, told: str) -> str:
    """The fix that belongs to an error, in braces."""
    fixes = [f["fix"] for f in _kept(folder) if f["fix"] and f["fact"] in told]
    return f" {{{fixes[0]}}}" if fixes else ""


def _kept(folder: Path) -> list[dict[str, str]]:
    """Findings of the reference on disk."""
    contents = [json.loads(file.read_text()) for file in sorted(folder.glob("*.json"))]
    return [finding for content in contents if isinstance(content, list) for finding in content]


def temporary_folder() -> tempfile.TemporaryDirectory[str]:
    """Where the files of an input are written."""
    return tempfile.TemporaryDirectory(prefix="wrong-input-")
