"""A simulated experiment written to disk as a measured one would be, with its truth beside it.

FOLDER/experiment.toml
       reference/0000.tif …   reference.csv   flats/…   darks/…
       STATE/0000.tif …       STATE.csv       STATE-truth.csv
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.motions_csv import write_motions
from grainmotion.io.tiff import write_tiff
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.simulate.detector import Recording

MAX_COUNT = 65_535  # of a 16-bit detector; a pixel with this count is saturated
_RESERVED = ("reference", "flats", "darks", "results")


def write_dataset(
    folder: str | Path,
    reference: Recording,
    states: Mapping[str, tuple[Recording, Motions]],
    grid: Volume,
    *,
    initial: Literal["previous", "reference"] = "previous",
) -> Path:
    """Write an experiment: 16-bit radiographs, geometry, ``experiment.toml``, and the truth of each state.

    ``states`` holds, by name and in loading order, radiographs and true motions from the reference state; flats and
    darks of the ``reference`` serve all of them.  ``grid`` is the one to reconstruct on, ``initial`` the key of each
    state.  Returns the path of the experiment file.
    """
    folder = Path(folder)
    beam = reference.geometry.beam
    for name, (recording, _) in states.items():
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._ -]*", name) or name.lower() in _RESERVED:
            raise InputError(f"state '{name}'", "the name cannot be its folder's", "use letters, digits, - and _")
        if recording.geometry.beam != beam:
            raise InputError(f"state '{name}'", f"a {recording.geometry.beam} beam", f"give a {beam} beam")
    for name in ("flats", "darks", "reference", *states):
        if (folder / name).is_dir() and any((folder / name).iterdir()):
            raise InputError(str(folder / name), "it already holds files", "empty it, or choose another folder")
    _write_images(folder / "flats", reference.flats)
    _write_images(folder / "darks", reference.darks)
    _write_images(folder / "reference", reference.counts)
    write_geometry(folder / "reference.csv", reference.geometry)
    for name, (recording, truth) in states.items():
        _write_images(folder / name, recording.counts)
        write_geometry(folder / f"{name}.csv", recording.geometry)
        write_motions(folder / f"{name}-truth.csv", truth)
    path = folder / "experiment.toml"
    path.write_text(_experiment(beam, list(states), grid, initial), encoding="utf-8")
    return path


def _write_images(folder: Path, images: NDArray[np.float32]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images):
        write_tiff(folder / f"{number:04d}.tif", np.clip(np.rint(image), 0, MAX_COUNT).astype(np.uint16))


def _experiment(beam: str, states: list[str], grid: Volume, initial: str) -> str:
    lines = [
        "# A simulated experiment: NAME-truth.csv holds the true motions of each state.",
        "",
        "[reference]",
        'radiographs = "reference/*.tif"',
        'flats = "flats/*.tif"',
        'darks = "darks/*.tif"',
        'kind = "counts"',
        'geometry = "reference.csv"',
        f'beam = "{beam}"',
        "",
        "[volume]",
        f"shape = {list(grid.shape)}  # z, y, x",
        f"voxel_size = {grid.voxel_size!r}  # mm",
        f"center = {list(grid.center)!r}  # mm, x y z",
    ]
    for name in states:
        lines += [
            "",
            "[[states]]",
            f'name = "{name}"',
            f'radiographs = "{name}/*.tif"',
            f'geometry = "{name}.csv"',
            f'initial = "{initial}"',
        ]
    return "\n".join([*lines, ""])
