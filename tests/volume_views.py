"""A random volume and views of it, by scanners with panels parallel to the rotation axis."""

import numpy as np

from grainmotion.kernels import volume_projection
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volume_operator import pad, padded_origin

PANEL = (21, 26)
SHAPE = (15, 18, 13)
ANGLES = np.linspace(0, 360, 24, endpoint=False) + 1.3


def cone(panel=None, **how):
    return Geometry.cone(ANGLES, PANEL, 0.4, source_to_axis=20, source_to_detector=80, panel=panel, **how)


def parallel(panel=None):
    return Geometry.parallel(ANGLES, PANEL, 0.1, panel=panel)


UPRIGHT_PANELS = {
    "cone": cone(),
    "parallel": parallel(),
    "panel beside the axis": cone(DetectorAlignment(detector_offset=(0.9, -0.6), axis_offset=0.13)),
    "panel rotated about z": cone(DetectorAlignment(detector_tilts_deg=(0, 0, 9))),
    "first row on top": cone(DetectorAlignment(first_row="top")),
    "small pixels": Geometry.cone(ANGLES, (53, 65), 0.15, source_to_axis=20, source_to_detector=80),
    "large pixels": Geometry.cone(ANGLES, (7, 9), 1.2, source_to_axis=20, source_to_detector=80),
}


def volume(precision=np.float32, center=(0.05, -0.1, 0.15)):
    rng = np.random.default_rng(0)
    return Volume(rng.uniform(size=SHAPE).astype(precision), 0.1, center)


def project_any_view(geometry, body, exact=False):
    """A x by the projector for any view."""
    out = np.empty((len(geometry), *geometry.shape), body.array.dtype)
    cone = geometry.beam == "cone"
    where = padded_origin(body), body.voxel_size, geometry.vectors, cone
    volume_projection.forward(pad(body.array), *where, exact, out)
    return out
