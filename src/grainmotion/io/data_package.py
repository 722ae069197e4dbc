"""``datapackage.json``: the files of a results folder, described as a Frictionless Data Package (datapackage.org).

Tables have a schema with type, unit and meaning of each column, all files a title; the package has version, frame and
the settings of the run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path

from grainmotion.io.catalogue import FILES, FileKind, kind_of, store_of
from grainmotion.io.files import atomic_write
from grainmotion.model.described_table import SAMPLE_FRAME

DATA_PACKAGE = "datapackage.json"
_FIELD_TYPES = {"text": "string", "": "string", "yes or no": "boolean"}


def write_data_package(folder: Path, paths: Iterable[Path], settings: Mapping[str, object]) -> None:
    """Describe the files of a results folder; a file that the catalogue lacks is listed without a description.

    It is written only if something changed.
    """
    package = {
        "name": "grainmotion-results",
        "title": "Motions of grains from a full scan and a few radiographs of each state",
        "grainmotion": version("grainmotion"),
        "frame": SAMPLE_FRAME,
        "units": "mm and degrees; motions.h5 in mm and radians, grains-ddic.tsv in voxels",
        "settings": settings,
        "resources": _resources(folder, paths),
    }
    text = json.dumps(package, indent=1, default=str)
    target = folder / DATA_PACKAGE
    if target.is_file() and target.read_text(encoding="utf-8") == text:
        return
    with atomic_write(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _resources(folder: Path, paths: Iterable[Path]) -> list[dict[str, object]]:
    """One entry a file; one for a whole OME-Zarr, and for all of the folder for DEM codes but its tables."""
    kinds: dict[str, FileKind | None] = {}
    for path in sorted(set(paths)):
        place = path.relative_to(folder).as_posix()
        table = next((kind for kind in FILES if kind.path == place and kind.columns), None)
        place = place if table is not None else store_of(place)
        kinds[place] = table or kind_of(place)
    return [_resource(place, kind) for place, kind in kinds.items()]


def _resource(place: str, kind: FileKind | None) -> dict[str, object]:
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in place.replace("/", ".").lower())
    found: dict[str, object] = {"name": name, "path": place, "format": Path(place).suffix.lstrip(".")}
    if kind is not None:
        found["title"] = kind.content
        if kind.columns:
            found["schema"] = {"fields": _fields(kind)}
            if place.endswith(".tsv"):
                found["dialect"] = {"delimiter": "\t"}
    return found


def _fields(kind: FileKind) -> list[dict[str, str]]:
    return [
        {"name": name, "type": _FIELD_TYPES.get(unit, "number"), "unit": unit, "description": meaning}
        for name, (unit, meaning) in kind.columns.items()
    ]
