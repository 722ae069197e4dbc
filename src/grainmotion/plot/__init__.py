"""Figures of scans, volumes and motions by matplotlib, one line each.

Every function draws into the ``Axes`` given as ``ax``, or into new ones, and returns them, so that a figure is changed
and saved as any other of matplotlib::

    ax = gm.plot.motions(motions, plane="xz")
    ax.set_title("after 2 mm of compression")
    ax.figure.savefig("motions.png", dpi=200)

matplotlib is loaded when the first figure is drawn.  Lengths are in mm, angles in degrees.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
