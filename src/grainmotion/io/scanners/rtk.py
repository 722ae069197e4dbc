"""RTK's geometry XML: nine numbers a projection, from which the places of source and panel follow.

Facts: RTK's documentation, "3D Circular Projection Geometry" (Apache-2.0), and files that RTK 2.7 wrote.  RTK's y is
the rotation axis; at 0° its source is at +z.  This package's (x, y, z) is RTK's (x, −z, y).
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.files import checked_file
from grainmotion.io.scanners.view_panel import Panel
from grainmotion.model.geometry import Geometry

ROOT = "RTKThreeDCircularGeometry"
VERSIONS = ("2", "3")
SHAPES: Mapping[str, float] = MappingProxyType(dict.fromkeys(
    ("GantryAngle", "InPlaneAngle", "OutOfPlaneAngle", "SourceToIsocenterDistance", "SourceToDetectorDistance",
     "SourceOffsetX", "SourceOffsetY", "ProjectionOffsetX", "ProjectionOffsetY"), 0.0,
))  # fmt: skip
"""The numbers of a projection, and what they are where the file leaves them out."""
MAX_MATRIX_ERROR = 1e-4
"""Of the largest number of a projection's matrix; RTK writes 15 digits."""
TO_SAMPLE_FRAME = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def read_rtk(path: Path, panel: Panel) -> Geometry:
    """The views of a file.

    Pixels are the panel's, centred where RTK's projections have the coordinates ``panel.offset``; row 0 lies lowest
    unless told otherwise, as in RTK.
    """
    root = _root(path)
    if panel.pixel_size is None:
        fact = "it does not hold the size of a pixel, which is in the header of RTK's projections"
        raise InputError(str(path), fact, "give geometry.pixel_size, in mm")
    common = _numbers(path, root, "the file")
    views = [_numbers(path, p, f"projection {k}", common) for k, p in enumerate(root.iter("Projection"))]
    if not views:
        raise InputError(str(path), "it holds no projection", "write it again with RTK")
    if root.find("RadiusCylindricalDetector") is not None and _number(path, root, "RadiusCylindricalDetector") != 0:
        raise InputError(str(path), "RadiusCylindricalDetector is not 0: a curved panel", "give a flat one")
    parallel = {view["SourceToDetectorDistance"] == 0 for view in views}
    if len(parallel) > 1:
        fact = "SourceToDetectorDistance is 0, for a parallel beam, in some projections only"
        raise InputError(str(path), fact, "correct the file")
    vectors = []
    for k, (view, element) in enumerate(zip(views, root.iter("Projection"), strict=True)):
        _check_matrix(path, k, view, element)
        vectors.append(_vectors(view, panel))
    return Geometry(np.array(vectors), panel.shape, "parallel" if parallel.pop() else "cone")


def _vectors(view: Mapping[str, float], panel: Panel) -> Float:
    """The 12 numbers of a view."""
    axes = _rotation(view).T  # columns: the panel's x, y, z in the fixed frame
    depth, whole = view["SourceToIsocenterDistance"], view["SourceToDetectorDistance"]
    across, up = view["ProjectionOffsetX"], view["ProjectionOffsetY"]
    step = np.array([0.0, panel.pixel_size or 0.0, 0.0]) * (-1 if panel.first_row == "top" else 1)
    offset = np.array([panel.offset[0], panel.offset[1] * (-1 if panel.first_row == "top" else 1)])
    center = np.array([across + offset[0], up + offset[1], depth - whole if whole else -depth])
    source = np.array([view["SourceOffsetX"], view["SourceOffsetY"], depth]) if whole else np.array([0.0, 0.0, -1.0])
    parts = (source, center, np.array([panel.pixel_size or 0.0, 0.0, 0.0]), step)
    return np.concatenate([TO_SAMPLE_FRAME @ axes @ part for part in parts])


def _rotation(view: Mapping[str, float]) -> Float:
    """From the fixed frame to that of the panel."""
    within, out, gantry = (-np.deg2rad(view[n]) for n in ("InPlaneAngle", "OutOfPlaneAngle", "GantryAngle"))
    about_z = np.array([[np.cos(within), -np.sin(within), 0], [np.sin(within), np.cos(within), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(out), -np.sin(out)], [0, np.sin(out), np.cos(out)]])
    about_y = np.array([[np.cos(gantry), 0, np.sin(gantry)], [0, 1, 0], [-np.sin(gantry), 0, np.cos(gantry)]])
    return np.asarray(about_z @ about_x @ about_y)


def _check_matrix(path: Path, k: int, view: Mapping[str, float], element: ElementTree.Element) -> None:
    """Refuse a projection whose own matrix contradicts its numbers."""
    text = element.findtext("Matrix")
    if text is None:
        return
    across, up = view["ProjectionOffsetX"], view["ProjectionOffsetY"]
    depth, whole = view["SourceToIsocenterDistance"], view["SourceToDetectorDistance"]
    right, high = view["SourceOffsetX"], view["SourceOffsetY"]
    turned = np.eye(4)
    turned[:3, :3] = _rotation(view)
    if whole:
        seen = np.array([[1, 0, right - across], [0, 1, high - up], [0, 0, 1]])
        magnified = np.array([[-whole, 0, 0, 0], [0, -whole, 0, 0], [0, 0, 1, -depth]])
        moved = np.array([[1, 0, 0, -right], [0, 1, 0, -high], [0, 0, 1, 0], [0, 0, 0, 1]])
        matrix = seen @ magnified @ moved @ turned
    else:
        matrix = np.array([[1, 0, 0, -across], [0, 1, 0, -up], [0, 0, 0, 1]]) @ turned
    try:
        written = np.array([float(word) for word in text.split()]).reshape(3, 4)
    except ValueError as error:
        raise InputError(str(path), f"the Matrix of projection {k} is no 3 x 4 numbers", "write it again") from error
    if not np.abs(written - matrix).max() <= MAX_MATRIX_ERROR * np.abs(matrix).max():
        fact = f"the Matrix of projection {k} contradicts its angles and distances"
        raise InputError(str(path), fact, "write the file again with RTK, or take its Matrix elements out")


def _root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(checked_file(path).read_bytes())
    except ElementTree.ParseError as error:
        raise InputError(str(path), f"truncated or malformed XML ({error})", "write it again with RTK") from error
    if root.tag != ROOT:
        raise InputError(
            str(path),
            f"its root is {root.tag}, not {ROOT}",
            "give a geometry file of RTK, or unireconstruction.xml of RX Solutions",
        )
    if root.get("version") not in VERSIONS:
        fact = f"version {root.get('version')} of the format, whose angles are others"
        raise InputError(str(path), fact, f"write it again with a newer RTK: version {VERSIONS[-1]}")
    return root


def _numbers(
    path: Path, element: ElementTree.Element, where: str, common: Mapping[str, float] = SHAPES
) -> dict[str, float]:
    return {
        n: default if element.find(n) is None else _number(path, element, n, where) for n, default in common.items()
    }


def _number(path: Path, element: ElementTree.Element, name: str, where: str = "the file") -> float:
    text = element.findtext(name) or ""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(str(path), f"{name} of {where} is '{text.strip()[:40]}', no number", "correct it there")
    return value
