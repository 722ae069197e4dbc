"""The peers' environments, and the machine on which a table was made."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Environment:
    """A folder beside the repository's files, and what `pip install` is given in it, call by call."""

    folder: str
    installs: tuple[tuple[str, ...], ...]

    def python(self) -> Path:
        """Its Python; the environment is made and filled if it is not there or holds something else."""
        folder = ROOT / self.folder
        python, stamp = folder / "bin" / "python", folder / ".peers"
        wanted = "\n".join(" ".join(arguments) for arguments in self.installs)
        if not stamp.exists() or stamp.read_text() != wanted:
            print(f"installing {wanted} into {self.folder} ...".replace("\n", ", "), flush=True)
            subprocess.run([sys.executable, "-m", "venv", folder], check=True)
            for arguments in self.installs:
                subprocess.run([python, "-m", "pip", "install", "--quiet", *arguments], check=True)
            stamp.write_text(wanted)
        return python


RTK = Environment(".venv-bench", (("itk-rtk>=2.7,<3",),))
# DiffDRR's renderer needs torch alone; what else it declares (viewers, readers, a registration) is not used.
DIFFDRR = Environment(".venv-diffdrr", (("torch==2.13.0",), ("numpy",), ("--no-deps", "diffdrr>=0.6,<0.7")))


def run_peer(script: str, job: dict[str, Any], folder: Path, environment: Environment = RTK) -> dict[str, Any]:
    """What ``validation/benchmarks/peers/SCRIPT`` prints about a job, as JSON on its last line."""
    path = folder / "job.json"
    path.write_text(json.dumps(job))
    command = [environment.python(), ROOT / "validation" / "benchmarks" / "peers" / script, path]
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
