"""Results in napari: volume, labels, moving surfaces, tracks and displacements on one slider of states.

napari is an extra, ``pip install 'grainmotion[viewer]'``, and is loaded when a window is opened::

    viewer = gm.viewer.open("results")

`layers` gives the same without a window, for viewers of one's own.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
