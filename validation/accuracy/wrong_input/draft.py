"""Draft: files and keys of an experiment before they are written, which a mistake changes."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from grainmotion.io.tiff import write_tiff
from validation.accuracy.wrong_input.laboratory import PANEL, VOXEL, Images, Laboratory, Recipe, images, laboratory
from validation.accuracy.wrong_input.laboratory import true_volume as volume_of

Value = str | float | int | bool | list["Value"] | dict[str, "Value"]  # type: ignore[misc]
Table = dict[str, Value]
Stack = NDArray[np.generic]
QUICK_SETTINGS: dict[str, Table] = {
    "calibrate": {"geometry": False},
    "reconstruct": {"sweeps": 3},
    "segment": {"finer": 1},
    "track": {"search": False},
}
"""Settings of the inputs that are wrong: a third of the time of the default ones.  Sound scans leave up to 0.03 voxel
and 0.6 degrees with them, and 0.03 voxel and 0.4 degrees by default."""
OPEN_BEAM_KEYS: Table = {"flats": "flats/*.tif", "darks": "darks/*.tif"}


@dataclass
class Draft:
    """An experiment of a laboratory; all of it may be changed before it is written.

    ``reference``, ``state``, ``flats`` and ``darks`` are images with row 0 as ``first_row`` says; ``frames`` are lists
    of files to leave out by folder, and ``after`` functions that write more files.
    """

    laboratory: Laboratory
    reference: Stack
    state: Stack
    flats: Stack
    darks: Stack
    keys: dict[str, Table]
    missing: dict[str, list[int]] = field(default_factory=dict)
    after: list[Callable[[Path], None]] = field(default_factory=list)

    @classmethod
    def of(cls, recipe: Recipe, settings: dict[str, Table] = QUICK_SETTINGS) -> Draft:
        """The right experiment, with tables of settings."""
        lab, shot = laboratory(recipe), images(recipe)
        stacks = (shot.reference, shot.state, shot.flats, shot.darks)
        if lab.draws["top"]:
            stacks = tuple(s[:, ::-1] for s in stacks)  # type: ignore[assignment]
        geometry: Table = {
            "beam": lab.beam,
            **lab.distances,
            "pixel_size": lab.pixel_size,
            "angles_deg": "angles.txt",
            "first_row": "top" if lab.draws["top"] else "bottom",
        }
        keys: dict[str, Table] = {
            "reference": {"radiographs": "reference/*.tif", **OPEN_BEAM_KEYS},
            "reference.geometry": geometry,
            "volume": {"shape": [PANEL[0], PANEL[1], PANEL[1]], "voxel_size": VOXEL},
            "states": {
                "name": "load",
                "radiographs": "load/*.tif",
                "geometry": {"angles_deg": numbers(lab.state_angles_deg)},
            },
        }
        keys |= settings
        draft = cls(lab, *(s.copy() for s in stacks), copy.deepcopy(keys))
        draft.write_angles(lab.angles_deg)
        return draft

    @property
    def recipe(self) -> Recipe:
        """Of the laboratory."""
        return self.laboratory.recipe

    @cached_property
    def rng(self) -> np.random.Generator:
        """For what a mistake draws."""
        return np.random.default_rng([self.recipe.seed, 11])

    @property
    def geometry(self) -> Table:
        """Keys of the reference's geometry."""
        return self.keys["reference.geometry"]

    @property
    def state_geometry(self) -> Table:
        """Keys of the state's geometry."""
        table = self.keys["states"]["geometry"]
        assert isinstance(table, dict)
        return table

    def write_angles(self, angles_deg: NDArray[np.float64]) -> None:
        """Angles of the full scan in a text file; the last call counts."""
        self.after.append(lambda folder: np.savetxt(folder / "angles.txt", angles_deg, fmt="%.6g"))

    def tell_state_angles(self, angles_deg: NDArray[np.float64]) -> None:
        """Angles of the state."""
        self.state_geometry["angles_deg"] = numbers(angles_deg)

    def use_recipe(self, **changes: float) -> None:
        """Radiographs of another laboratory of the same seed."""
        other = Draft.of(replace(self.recipe, **changes))  # type: ignore[arg-type]
        self.laboratory, self.reference, self.state = other.laboratory, other.reference, other.state

    def give_volume(self, volume: Stack | None = None, labels: Stack | None = None) -> None:
        """A volume and labels of other software instead of the full scan; the true ones unless given."""
        true, true_labels = volume_of(self.recipe)
        chosen = true if volume is None else volume, true_labels if labels is None else labels
        self.reference = self.reference[:0]
        given = self.keys["reference.geometry"]
        del self.keys["reference.geometry"]
        angles = self.state_geometry["angles_deg"]
        self.keys["reference"] = {"volume": "volume.tif", "labels": "labels.tif"}
        self.keys["states"] |= {**OPEN_BEAM_KEYS, "geometry": {**given, "angles_deg": angles}}

        def write(folder: Path) -> None:
            for name, array in zip(("volume.tif", "labels.tif"), chosen, strict=True):
                write_tiff(folder / name, np.ascontiguousarray(array))

        self.after.append(write)

    def without_labels(self) -> None:
        """The volume alone."""
        del self.keys["reference"]["labels"]

    @property
    def stacks(self) -> dict[str, Stack]:
        """Images by folder, those of the state last."""
        return {"reference": self.reference, "flats": self.flats, "darks": self.darks, "load": self.state}

    def write_state(self, folder: Path, name: str) -> Path:
        """The state under a name of its own, and the experiment file, where all other files are already."""
        self.keys["states"] |= {"name": name, "radiographs": f"{name}/*.tif"}
        return self.write(folder, {name: self.state})

    def write(self, folder: Path, stacks: dict[str, Stack] | None = None) -> Path:
        """All files, or other stacks of images; returns the path of the experiment file."""
        for name, stack in (self.stacks if stacks is None else stacks).items():
            place = folder / name
            place.mkdir(parents=True, exist_ok=True)
            for k, image in enumerate(stack):
                if k not in self.missing.get(name, ()):
                    write_tiff(place / f"scan_{k:04d}.tif", np.ascontiguousarray(image))
        for write in self.after if stacks is None else ():
            write(folder)
        path = folder / "experiment.toml"
        path.write_text(toml(self.keys))
        return path


def write_hdf5(path: Path, **stacks: Stack) -> None:
    """Images in one HDF5 file, by name."""
    with h5py.File(path, "w") as file:
        for name, stack in stacks.items():
            file[name] = stack


def numbers(values: NDArray[np.float64]) -> list[Value]:
    """Plain numbers for a key."""
    return [round(float(v), 6) for v in values]


def toml(keys: dict[str, Table]) -> str:
    """Tables as TOML."""
    lines = []
    for name, table in keys.items():
        lines += [f"[[{name}]]" if name == "states" else f"[{name}]"]
        lines += [f"{key} = {_value(value)}" for key, value in table.items()]
    return "\n".join([*lines, ""])


def _value(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    return repr(value)


__all__ = ["Draft", "Images", "numbers", "toml", "write_hdf5"]
