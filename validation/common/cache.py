"""Results that are kept: whatever is slow is made once, and read from then on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import grainmotion

Arrays = dict[str, NDArray[np.generic]]


def kept(path: Path, make: Callable[[], Arrays]) -> Arrays:
    """Arrays from an .npz file, made and put there if it does not exist."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part.npz")
        np.savez(part, **make())
        part.replace(path)  # so that a run cut short leaves no half file
    with np.load(path) as file:
        return dict(file)


def kept_record(path: Path, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Plain values from a .json file, likewise."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part.json")
        part.write_text(json.dumps(make()))
        part.replace(path)
    return dict(json.loads(path.read_text()))


def digest(text: str) -> str:
    """A short name for a long description."""
    return hashlib.sha256(text.encode()).hexdigest()[:8]


@cache
def source(*names: str) -> str:
    """A short name for the source of some modules and folders of the package as it is now."""
    root = Path(grainmotion.__file__).parent
    files = [file for name in names for file in sorted((root / name).rglob("*.py")) or [root / f"{name}.py"]]
    return digest("\n".join(file.read_text() for file in files))
