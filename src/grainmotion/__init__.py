"""grainmotion: the rigid motion of every grain, from one tomography scan and a few radiographs per state.

The whole job in a notebook::

    import grainmotion as gm

    beam = dict(flats="flats/*.tif", darks="darks/*.tif")
    scan = gm.read_scan("reference/*.tif", "reference.csv", **beam)
    grid = gm.Volume.zeros((280, 180, 180), voxel_size=0.112)  # z, y, x; mm
    reference = gm.Reference.from_scan(scan, grid)  # calibrate, reconstruct, segment, extract the grains
    state = gm.read_scan("step-01/*.tif", "step-01.csv", **beam)
    motions = gm.track(reference.grains, reference.correct(state))
    motions.to_table()
"""

from __future__ import annotations

import warnings
from importlib.metadata import version

import lazy_loader

__version__ = version("grainmotion")
_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
_FORMER_NAMES = {"Panel": "DetectorAlignment"}


def __getattr__(name: str) -> object:
    if name in _FORMER_NAMES:
        warnings.warn(f"grainmotion.{name} is now grainmotion.{_FORMER_NAMES[name]}", DeprecationWarning, stacklevel=2)
        name = _FORMER_NAMES[name]
    return _load(name)
