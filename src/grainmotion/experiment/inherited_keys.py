"""Keys of the experiment file that a table has from another one, filled in before the tables are validated."""

from __future__ import annotations

from collections.abc import Mapping

from grainmotion.errors import InputError
from grainmotion.io.scanners.identify import is_scanner_file

ANGLE_KEYS = ("angles_deg", "first", "last", "count", "step")
"""Keys of a circular scan that a state never has from the reference."""
TOLD_BY_FILES = ("pixel_size", "first_row")
"""Required keys of a circular scan that a scanner's file may tell instead."""


def with_inherited_keys(data: Mapping[str, object]) -> dict[str, object]:
    """Fill in the projector of ``[track]``, the outline of ``[reconstruct]``, and circular scans.

    ``[track]`` has the projector of ``[reconstruct]``, ``[reconstruct]`` the outline of ``[volume]``, and the circular
    scan of a state the keys of the reference's but the angles.  Required keys that a scanner's file may tell are None.
    """
    states = data.get("states", [])
    if not isinstance(states, list):
        raise InputError("states", "it is no list of tables", "write [[states]] with double brackets")
    tables = {**data, "states": states}
    reconstruct, track = data.get("reconstruct"), data.get("track", {})
    if isinstance(reconstruct, dict) and isinstance(track, dict) and "projector" in reconstruct:
        tables["track"] = {"projector": reconstruct["projector"], **track}
    volume = data.get("volume")
    if isinstance(volume, dict) and "outline" in volume and isinstance(reconstruct, dict | None):
        tables["reconstruct"] = {"outline": volume["outline"], **(reconstruct or {})}
    reference = data.get("reference")
    common = {key: value for key, value in (_circle(reference) or {}).items() if key not in ANGLE_KEYS}
    tables["states"] = [_with_circle(state, common, _has_scanner_file(reference)) for state in states]
    if "watch" in data:
        tables["watch"] = _with_circle(data["watch"], common, _has_scanner_file(reference))
    if isinstance(reference, dict):
        tables["reference"] = _with_circle(reference, {}, False)
    return tables


def _with_circle(scan: object, common: Mapping[str, object], told: bool) -> object:
    """The table of a scan with ``common`` keys in its circle, and None where a file may tell."""
    circle = _circle(scan)
    if circle is None or not isinstance(scan, dict):
        return scan
    by_file = dict.fromkeys(TOLD_BY_FILES) if told or _has_scanner_file(scan) or "file" in circle else {}
    return {**scan, "geometry": {**by_file, **common, **circle}}


def _circle(scan: object) -> dict[str, object] | None:
    """The table of a circular scan, if the scan has one."""
    geometry = scan.get("geometry") if isinstance(scan, dict) else None
    return geometry if isinstance(geometry, dict) else None


def _has_scanner_file(scan: object) -> bool:
    """Whether radiographs or geometry of a scan are in one file of a scanner."""
    if not isinstance(scan, dict):
        return False
    radiographs, geometry = scan.get("radiographs"), scan.get("geometry")
    if isinstance(radiographs, list) and len(radiographs) == 1:
        radiographs = radiographs[0]
    return any(isinstance(name, str) and is_scanner_file(name) for name in (radiographs, geometry))
