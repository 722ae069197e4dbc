"""RTK on the circular cone-beam scans of `simulate.Scanner`, each call in a process of ``.venv-bench``."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion.simulate import Scanner
from validation.benchmarks.peers.environment import run_peer

Result = tuple[NDArray[np.float32], float, str]
"""Array, CPU seconds and RTK's version."""


def forward_projection(volume: NDArray[np.floating], scanner: Scanner, angles_deg: Sequence[float]) -> Result:
    """Radiographs of a volume by RTK's Joseph projector."""
    return _run("rtk_joseph.py", {"volume": volume}, scanner, angles_deg, panel=scanner.panel)


def filtered_back_projection(
    radiographs: NDArray[np.floating], scanner: Scanner, angles_deg: Sequence[float], hann: float
) -> Result:
    """Volume by FDK; ``hann`` is the window's cut-off as a share of Nyquist's frequency, 0 for the plain ramp."""
    return _run("rtk_fdk.py", {"radiographs": radiographs}, scanner, angles_deg, shape=scanner.grid.shape, hann=hann)


def sart_sweep(
    radiographs: NDArray[np.floating],
    scanner: Scanner,
    angles_deg: Sequence[float],
    relaxation: float,
    back_projector: str,
) -> Result:
    """Volume after one sweep of SART from zeros, by the back-projector "joseph" or "voxels"."""
    options = {"shape": scanner.grid.shape, "relaxation": relaxation, "back_projector": back_projector}
    return _run("rtk_sart.py", {"radiographs": radiographs}, scanner, angles_deg, **options)


def _run(
    script: str, arrays: dict[str, NDArray[np.floating]], scanner: Scanner, angles_deg: Sequence[float], **options: Any
) -> Result:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for key, array in arrays.items():
            np.save(folder / f"{key}.npy", array)
        job = {
            **{key: str(folder / f"{key}.npy") for key in (*arrays, "out")},
            "voxel_size": scanner.voxel_size,
            "pixel_size": scanner.pixel_size,
            "source_to_axis": scanner.source_to_axis,
            "source_to_detector": scanner.source_to_detector,
            "angles_deg": list(angles_deg),
            **options,
        }
        reply = run_peer(script, job, folder)
        return np.load(folder / "out.npy"), reply["cpu"], reply["version"]
