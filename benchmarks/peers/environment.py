"""The peers' environment ``.venv-bench``, and the machine on which a table was made."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PEERS = ("itk-rtk>=2.7,<3",)


def peers_python() -> Path:
    """Python of ``.venv-bench``, which is made and filled if it is not there."""
    folder = ROOT / ".venv-bench"
    python, stamp = folder / "bin" / "python", folder / ".peers"
    wanted = "\n".join(PEERS)
    if not stamp.exists() or stamp.read_text() != wanted:
        print(f"installing {wanted} into .venv-bench ...", flush=True)
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PEERS], check=True)
        stamp.write_text(wanted)
    return python


def run_peer(script: str, job: dict[str, Any], folder: Path) -> dict[str, Any]:
    """What ``benchmarks/peers/SCRIPT`` prints about a job, as JSON on its last line."""
    path = folder / "job.json"
    path.write_text(json.dumps(job))
    command = [peers_python(), ROOT / "benchmarks" / "peers" / script, path]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.strip().splitlines()[-1])


def machine() -> str:
    """Processor, number of cores and versions, in a line."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":")[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        name = names[0] if names else name
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    packages = ", ".join(f"{p} {version(p)}" for p in ("grainmotion", "numba", "numpy"))
    return f"{name}, {cores} cores, {platform.system()}, Python {platform.python_version()}, {packages}"
