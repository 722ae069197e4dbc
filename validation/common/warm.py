"""Compilation out of the way, so that CPU times do not hold it."""

from __future__ import annotations

from functools import cache

from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, small
from grainmotion.tracking.track import TrackSettings, track


@cache
def compile_kernels() -> None:
    """Track a tiny case once by each projector."""
    tiny = small(n_grains=3)
    scan = tiny.reference().select(slice(None, None, 6))
    volume = reconstruct(scan, tiny.scanner.grid, ReconstructSettings(sweeps=1)).volume
    sample = grains_from_labels(volume, segment(volume).labels)
    later = tiny.state(tiny.motions["unmoved"], LATER_ANGLES_DEG[2])
    track(sample, later)
    track(sample, later, settings=TrackSettings(projector="exact"))
