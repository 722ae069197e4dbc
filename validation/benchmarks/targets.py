"""grainmotion's part of a benchmark with kernels compiled for this processor, and for one that has AVX2 alone.

Each runs in a process of its own: numba compiles for one processor in a process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding
from numpy.typing import NDArray

ROOT = Path(__file__).parents[2]
NATIVE = "this processor"
TARGETS: dict[str, dict[str, str]] = {
    NATIVE: {},
    "AVX2": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""},
}


def targets() -> list[str]:
    """Names of the targets whose code this processor runs."""
    return [name for name in TARGETS if name == NATIVE or binding.get_host_cpu_features().get("avx2")]


def run_for(
    target: str, module: str, options: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> tuple[dict[str, float], dict[str, NDArray[Any]]]:
    """CPU seconds and arrays that ``python -m MODULE --part FOLDER`` leaves; see `part_of` for its side."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "options.json").write_text(json.dumps(dict(options)))
        np.savez(folder / "given.npz", **arrays)
        environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_CPU")} | TARGETS[target]
        if target != NATIVE:
            environment["NUMBA_CACHE_DIR"] = str(folder / "kernels")
        command = [sys.executable, "-m", module, "--part", str(folder)]
        subprocess.run(command, check=True, cwd=ROOT, env=environment)
        with np.load(folder / "found.npz") as found:
            return json.loads((folder / "seconds.json").read_text()), dict(found)


def part_of(folder: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Options and arrays that `run_for` gave."""
    with np.load(folder / "given.npz") as given:
        return json.loads((folder / "options.json").read_text()), dict(given)


def leave(folder: Path, seconds: Mapping[str, float], arrays: Mapping[str, NDArray[Any]]) -> None:
    """What `run_for` returns."""
    (folder / "seconds.json").write_text(json.dumps(dict(seconds)))
    np.savez(folder / "found.npz", **arrays)
