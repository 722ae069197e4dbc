"""Compilation before measuring, so that CPU times do not contain it."""

from __future__ import annotations

from functools import cache

from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, small
from grainmotion.tracking.track import TrackSettings, track


@cache
def compile_kernels() -> None:
    """Reconstruct a tiny case by both methods and track it by both projectors, once a process."""
    case = small(n_grains=3)
    scan = case.reference().select(slice(None, None, 6))
    reconstruct(scan, case.scanner.grid, ReconstructSettings(method="accelerated"))
    volume = reconstruct(scan, case.scanner.grid, ReconstructSettings(sweeps=1)).volume
    grains = grains_from_labels(volume, segment(volume).labels)
    later = case.state(case.motions["unmoved"], LATER_ANGLES_DEG[2])
    track(grains, later)
    track(grains, later, settings=TrackSettings(projector="exact"))
