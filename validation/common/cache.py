"""Results cached on disk: computed once for each set of arguments, and again after the package's source has changed."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from joblib import Memory

import grainmotion

SIMULATION = ("_typing", "rotations", "kernels", "model", "simulate")
"""Modules and packages of grainmotion on which simulated radiographs depend."""
RECONSTRUCTION = (*SIMULATION, "backends", "projection", "preprocessing", "solvers", "reconstruction")
SEGMENTATION = (*RECONSTRUCTION, "segmentation")
TRACKING = (*SEGMENTATION, "calibration", "objective", "uncertainty", "tracking", "analysis")


@cache
def source_digest(*names: str) -> str:
    """Short hash of the source of some modules and packages of grainmotion as it is now."""
    root = Path(grainmotion.__file__).parent
    files = [file for name in names for file in sorted((root / name).rglob("*.py")) or [root / f"{name}.py"]]
    return hashlib.sha256("\n".join(file.read_text() for file in files).encode()).hexdigest()[:8]


def memory(folder: Path, sources: tuple[str, ...]) -> Memory:
    """Store of results in ``folder`` that is valid while the named sources stay as they are."""
    return Memory(folder / source_digest(*sources), verbose=0)
