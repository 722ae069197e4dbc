"""Views as a geometry of the ASTRA toolbox, and back."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypedDict

import numpy as np

from grainmotion._typing import Beam, Float
from grainmotion.errors import InputError

ASTRA_TYPES: Mapping[Beam, str] = MappingProxyType({"cone": "cone_vec", "parallel": "parallel3d_vec"})
"""ASTRA's name of a geometry of vectors, by its beam."""


class AstraGeometry(TypedDict):
    """A projection geometry of ASTRA's ``cone_vec`` or ``parallel3d_vec``."""

    type: str
    DetectorRowCount: int
    DetectorColCount: int
    Vectors: Float


def astra_geometry(vectors: Float, shape: tuple[int, int], beam: Beam) -> AstraGeometry:
    """What ``astra.create_proj_geom`` makes of views ``(n, 12)`` on a panel of ``shape`` pixels (copied)."""
    return {
        "type": ASTRA_TYPES[beam],
        "DetectorRowCount": shape[0],
        "DetectorColCount": shape[1],
        "Vectors": vectors.copy(),
    }


def views_of_astra(geometry: AstraGeometry) -> tuple[Float, tuple[int, int], Beam]:
    """Views ``(n, 12)``, rows and columns of the panel, and beam of a geometry of ASTRA."""
    beams: dict[str, Beam] = {name: beam for beam, name in ASTRA_TYPES.items()}
    kind = geometry.get("type")
    if kind not in beams:
        raise InputError("ASTRA geometry", f"type '{kind}' is not one of {sorted(beams)}", "use astra.geom_2vec first")
    shape = (geometry["DetectorRowCount"], geometry["DetectorColCount"])
    return np.asarray(geometry["Vectors"], dtype=float), shape, beams[kind]
