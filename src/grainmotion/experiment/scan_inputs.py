"""One scan of an experiment file: its files found, its geometry made, its pixels read as line integrals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Beam
from grainmotion.errors import InputError
from grainmotion.experiment.circular import _angles, circular_geometry
from grainmotion.experiment.config import Air, Circular, Kind, ReferenceTable, ScanTable
from grainmotion.io.geometry_csv import read_geometry
from grainmotion.io.hdf5 import DARK, FLAT, NXtomo
from grainmotion.io.stacks import Stack, find_stack
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan, normalize_air
from grainmotion.preprocessing.beam_hardening import Hardening
from grainmotion.preprocessing.flat_field import (
    PixelReport,
    checked_line_integrals,
    line_integrals_from_counts,
    line_integrals_from_transmission,
)


@dataclass(frozen=True, eq=False)
class ScanInput:
    """The files of one scan, found and checked, and how to read them.

    Attributes
    ----------
    key : str
        "reference" or "states.NAME".
    radiographs : Stack
    flats, darks : Stack, optional
    kind : {"counts", "transmission", "line-integrals"}
    geometry : Geometry
        Of the chosen views.
    views : int array, optional
        Which radiographs to use; None for all.
    air : Air, optional
    saturation : float, optional
    hardening : Hardening, optional
        Curve that makes the line integrals linear; no part of the `settings`.
    """

    key: str
    radiographs: Stack
    flats: Stack | None
    darks: Stack | None
    kind: Kind
    geometry: Geometry
    views: NDArray[np.int64] | None = None
    air: Air | None = None
    saturation: float | None = None
    hardening: Hardening | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """All image files."""
        stacks = (self.radiographs, self.flats, self.darks)
        return tuple(f for s in stacks if s is not None for f in s.files)

    @property
    def settings(self) -> dict[str, Any]:
        """What else decides the line integrals, as plain data."""
        return {
            "kind": self.kind,
            "beam": self.geometry.beam,
            "geometry": self.geometry.vectors.tolist(),
            "views": None if self.views is None else self.views.tolist(),
            "air": None if self.air is None else self.air.model_dump(),
            "saturation": self.saturation,
            "inner": [[p.inner, p.key] for s in (self.radiographs, self.flats, self.darks) if s for p in s.parts],
        }

    def select(self, views: NDArray[np.int64]) -> ScanInput:
        """Some of the chosen views, in the order asked for."""
        chosen = views if self.views is None else self.views[views]
        return replace(self, views=chosen, geometry=self.geometry[views])

    def read(self) -> tuple[Scan, PixelReport]:
        """Read the radiographs as line integrals; errors name the files and the key."""
        images = self.radiographs.read(self.views)
        try:
            if self.kind == "counts":
                flats = None if self.flats is None else self.flats.read()
                darks = None if self.darks is None else self.darks.read()
                assert flats is not None  # find_inputs saw to it
                scan, report = line_integrals_from_counts(
                    images, flats, darks, self.geometry, saturation=self.saturation
                )
            elif self.kind == "transmission":
                scan, report = line_integrals_from_transmission(images, self.geometry)
            else:
                scan, report = checked_line_integrals(images, self.geometry)
            if self.air is not None:
                scan = normalize_air(scan, margin=self.air.margin, region=self.air.region)
        except InputError as error:
            raise InputError(self._named(error.where), error.fact, error.remedy) from error
        return (scan if self.hardening is None else self.hardening.apply(scan)), report

    def _named(self, where: str) -> str:
        """File and key behind the "counts", "flats" or "darks" of an error."""
        stack = {"flats": self.flats, "darks": self.darks}.get(where, self.radiographs)
        key = where if where in ("flats", "darks") or where.startswith("air") else "radiographs"
        return f"{stack.spec if stack else ''} ({self.key}.{key})"


def read_scan(
    radiographs: str | Path | Sequence[str | Path],
    geometry: Geometry | str | Path,
    *,
    flats: str | Path | Sequence[str | Path] | None = None,
    darks: str | Path | Sequence[str | Path] | None = None,
    kind: Kind = "counts",
    beam: Beam = "cone",
    air: Air | None = None,
) -> Scan:
    """Read a scan from files, as a table of the experiment file would.

    Parameters
    ----------
    radiographs : path, glob, ``"file.h5::/path"``, or a list of those
        TIFF, .npy, HDF5 or one NXtomo file, which brings flats and darks unless they are given.
    geometry : Geometry or path
        Or its CSV, one row a radiograph.
    flats, darks : like ``radiographs``, optional
        Images of the open beam and of no beam; averaged.
    kind : {"counts", "transmission", "line-integrals"}
    beam : {"cone", "parallel"}
        Of a geometry read from CSV.
    air : Air, optional
        Where only air is seen, ``Air(margin=8)`` or ``Air(region=(0, 20, 0, 20))``.

    Returns
    -------
    Scan
    """
    images = find_stack(radiographs)
    (count, rows, columns), _ = images.info()
    views = geometry if isinstance(geometry, Geometry) else read_geometry(geometry, (rows, columns), beam)
    if len(views) != count:
        where = "geometry" if isinstance(geometry, Geometry) else str(geometry)
        fact = f"{len(views)} views, but {images.spec} holds {count} radiographs"
        raise InputError(where, fact, "give one view a radiograph, in the same order")
    table = ReferenceTable(kind=kind)
    given = [None if files is None else find_stack(files) for files in (flats, darks)]
    if images.nxtomo is not None:
        own = [_find_beam_images("reference", n, table, table, Path(), images.nxtomo) for n in ("flats", "darks")]
        given = [g or o for g, o in zip(given, own)]
    if kind == "counts" and given[0] is None:
        raise InputError("flats", "it is missing", "give flats, or set kind to what the images are")
    return ScanInput("scan", images, given[0], given[1], kind, views, air=air).read()[0]


def find_scan(key: str, table: ScanTable, reference: ReferenceTable, folder: Path) -> ScanInput:
    """Find one scan; what its table does not say is the reference's."""
    radiographs = named_stack(f"{key}.radiographs", table.radiographs, folder)
    if radiographs is None:
        raise InputError(f"{key}.radiographs", "it is missing", "name the radiographs")
    kind = table.kind or reference.kind or "counts"
    (count, rows, columns), _ = radiographs.info()
    nxtomo = radiographs.nxtomo
    views = _chosen(key, table.views, count)
    geometry = _find_geometry(key, table, reference, folder, (rows, columns), nxtomo)
    if len(geometry) == count and views is not None:
        geometry = geometry[views]
    used = count if views is None else len(views)
    if len(geometry) != used:
        source = f"{key}.geometry"
        if isinstance(table.geometry, str):
            source = f"{table.geometry} ({source})"
        fact = f"{len(geometry)} views, but {radiographs.spec} ({key}.radiographs) holds {count} radiographs"
        fact += "" if used == count else f", of which {used} are chosen"
        raise InputError(source, fact, "give one view a radiograph, in the same order")
    flats, darks = (_find_beam_images(key, name, table, reference, folder, nxtomo) for name in ("flats", "darks"))
    if kind != "counts":
        flats = darks = None
    elif flats is None:
        raise InputError(f"{key}.flats", "it is missing", "give flats, or set kind to what the images are")
    for name, stack in (("flats", flats), ("darks", darks)):
        if stack is not None and stack.info()[0][1:] != (rows, columns):
            fact = f"images of {stack.info()[0][1:]} pixels, but the radiographs have {(rows, columns)}"
            raise InputError(f"{stack.spec} ({key}.{name})", fact, f"give {name} of the same camera settings")
    return ScanInput(
        key=key,
        radiographs=radiographs,
        flats=flats,
        darks=darks,
        kind=kind,
        geometry=geometry,
        views=views,
        air=table.air or reference.air,
        saturation=table.saturation or reference.saturation,
    )


def _find_beam_images(
    key: str, name: str, table: ScanTable, reference: ReferenceTable, folder: Path, nxtomo: NXtomo | None
) -> Stack | None:
    """Flats or darks: the table's, its NXtomo file's, the reference's, the reference's NXtomo file's."""
    frames = FLAT if name == "flats" else DARK
    own = named_stack(f"{key}.{name}", getattr(table, name), folder)
    if own is not None:
        return own
    if nxtomo is not None and nxtomo.count(frames):
        return find_stack(nxtomo.path).frames(frames)
    if key == "reference":
        return None
    shared = named_stack(f"reference.{name}", getattr(reference, name), folder)
    if shared is None and reference.radiographs is not None:
        first = named_stack("reference.radiographs", reference.radiographs, folder)
        file = None if first is None else first.nxtomo
        if first is not None and file is not None and file.count(frames):
            shared = first.frames(frames)
    return shared


def _find_geometry(
    key: str,
    table: ScanTable,
    reference: ReferenceTable,
    folder: Path,
    shape: tuple[int, int],
    nxtomo: NXtomo | None,
) -> Geometry:
    given = table.geometry
    if given is None and nxtomo is not None and isinstance(reference.geometry, Circular):
        given = reference.geometry.model_copy(update={"angles_deg": None, "first": None, "last": None, "count": None})
    if given is None:
        raise InputError(f"{key}.geometry", "it is missing", "name a CSV, or give a table for a circular scan")
    circular = reference.geometry.beam if isinstance(reference.geometry, Circular) else None
    inherited: Beam = table.beam or reference.beam or circular or "cone"
    if isinstance(given, str):
        return read_geometry(folder / given, shape, inherited)
    try:
        angles = _angles(given, folder, nxtomo)
        return circular_geometry(given, given.beam or inherited, shape, angles)
    except InputError as error:
        where = error.where if error.where.startswith(str(folder)) else f"{key}.{error.where}"
        raise InputError(where, error.fact, error.remedy) from error


def _chosen(key: str, views: str | list[int] | None, count: int) -> NDArray[np.int64] | None:
    """Indices that "start:stop:step" or a list picks from ``count`` radiographs."""
    if views is None:
        return None
    try:
        if isinstance(views, str):
            numbers = [int(p) if p.strip() else None for p in views.split(":")]
            index = np.arange(count)[slice(*numbers)] if 2 <= len(numbers) <= 3 else np.array([numbers[0]], int)
        else:
            index = np.arange(count)[np.array(views, dtype=int)]
    except (ValueError, TypeError, IndexError) as error:
        fact = f"'{views}' does not pick from {count} radiographs"
        raise InputError(f"{key}.views", fact, 'give "start:stop:step" or a list of indices from 0') from error
    if len(index) == 0 or index.max() >= count:
        raise InputError(f"{key}.views", f"'{views}' picks none of {count} radiographs", "widen the selection")
    return index


def named_stack(key: str, files: list[str] | None, folder: Path) -> Stack | None:
    """The stack behind a key; errors name the file and the key."""
    if files is None:
        return None
    try:
        return find_stack(files if len(files) > 1 else files[0], folder)
    except InputError as error:
        raise InputError(f"{error.where} ({key})", error.fact, error.remedy) from error
