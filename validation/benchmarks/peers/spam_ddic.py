"""Discrete correlation of two full scans by spam (https://www.spam-project.dev), from PyPI, in ``.venv-spam``.

Three of its scripts, each starting from the one before: ``spam-reg`` (the sample as one body),
``spam-pixelSearch`` (whole voxels, each grain), ``spam-ddic`` (the motions).  One process each.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pandas as pd

from validation.benchmarks.peers.environment import ROOT

SCRIPTS = ROOT / ".venv-spam" / "bin"
REG_BINNING = 8  # of the images with which `spam-reg` begins
SEARCH_RANGE = (7, 7, 7)  # voxels to search along z, y and x once the sample is registered as a body
ONE_THREAD = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def make_environment() -> None:
    """``.venv-spam`` by the recipe in the Makefile, unless it is there."""
    command = ["make", "--quiet", f"PYTHON={sys.executable}", ".venv-spam/.installed"]
    subprocess.run(command, cwd=ROOT, check=True)


def spam_version() -> str:
    """Version of spam in ``.venv-spam``."""
    ask = "from importlib.metadata import version; print(version('spam'))"
    return subprocess.run([SCRIPTS / "python", "-c", ask], check=True, capture_output=True, text=True).stdout.strip()


@dataclass(frozen=True)
class Pair:
    """The files of two full scans and the folder for what spam writes."""

    reference: Path
    labels: Path
    state: Path
    folder: Path

    def approach(self, reach: Sequence[int]) -> tuple[Path, float]:
        """Where each grain is, in whole voxels: the TSV for `correlate`, and CPU seconds.

        The search is ``SEARCH_RANGE`` the motion of the sample as one body if `spam-reg` converges to one, else it
        starts from zero and extends to ``reach`` along z, y and x.
        """
        out = ("-od", self.folder, "-pre")
        cpu = timed("spam-reg", "-rig", "-bb", REG_BINNING, *out, "body", self.reference, self.state)
        body = self.folder / "body-registration.tsv"
        found = pd.read_csv(body, sep="\t")["returnStatus"][0] == 2
        start = ("-F", "rigid", "-pf", body) if found else ()
        ways = [way for far in (SEARCH_RANGE if found else reach) for way in (-far, far)]
        search = ("-np", 1, "-sr", *ways, "-lab1", self.labels, *start, *out, "grains")
        cpu += timed("spam-pixelSearch", *search, self.reference, self.state)
        return self.folder / "grains-pixelSearch.tsv", cpu

    def correlate(self, start: Path, options: Sequence[str | int] = ()) -> tuple[Path, float]:
        """Motions of all grains: ``spam-ddic``'s TSV, and CPU seconds."""
        out = ("-od", self.folder, "-pre", "grains")
        images = (self.reference, self.labels, self.state)
        cpu = timed("spam-ddic", "-np", 1, *options, "-pf", start, *out, *images)
        return self.folder / "grains-ddic.tsv", cpu


def timed(name: str, *arguments: str | int | Path) -> float:
    """CPU seconds of one of spam's scripts, without what it takes to start and to import."""
    return max(_run(name, *arguments) - _start_up(name), 0.0)


@cache
def _start_up(name: str) -> float:
    _run(name, "--help")  # which may compile and write caches
    return _run(name, "--help")


def _run(name: str, *arguments: str | int | Path) -> float:
    """CPU seconds, user and system, of a script and of the processes that it starts."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [str(SCRIPTS / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **dict.fromkeys(ONE_THREAD, "1")})
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
