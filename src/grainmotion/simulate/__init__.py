"""Simulation with exact shapes: samples, motions and radiographs whose true values are known.

Particles are triangle meshes or ellipsoids, their line integrals are exact, and pixels average intensities,
so that simulated radiographs share nothing with the projector of the tracker.
"""

from __future__ import annotations

import warnings

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
_FORMER_SIMULATE_NAMES = {"Slip": "Misalignment"}


def __getattr__(name: str) -> object:
    if name in _FORMER_SIMULATE_NAMES:
        warnings.warn(
            f"simulate.{name} is now simulate.{_FORMER_SIMULATE_NAMES[name]}", DeprecationWarning, stacklevel=2
        )
        name = _FORMER_SIMULATE_NAMES[name]
    return _load(name)
