"""A simulated experiment written to disk as a measured one would be, with its truth beside it.

FOLDER/experiment.toml
       reference/0000.tif …   reference.csv   flats/…   darks/…
       STATE/0000.tif …       STATE.csv       STATE-truth.csv
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion.errors import InputError
from grainmotion.io.files import checked_folder
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.motions_csv import write_motions
from grainmotion.io.tiff import write_tiff
from grainmotion.model.motions import Motions
from grainmotion.model.progress import begin, counted
from grainmotion.model.volume import Volume
from grainmotion.simulate.detector import Recording

MAX_COUNT = 65_535  # of a 16-bit detector; a pixel with this count is saturated
_RESERVED = ("reference", "flats", "darks", "results")
_EXPERIMENT, _UNFINISHED = "experiment.toml", ".unfinished-simulation"


def check_new_dataset(folder: str | Path, states: Iterable[str] = ()) -> None:
    """Refuse a folder whose files a simulated experiment would replace or be mixed with.

    Raises
    ------
    InputError
        If the folder cannot be written to, or holds an experiment file, or files where those of the reference or of
        one of the ``states`` would be.
    """
    folder = checked_folder(folder)
    remedy = "choose another folder, so that no file of yours is replaced"
    names = ["reference", *states]
    for name in ("flats", "darks", *names):
        if (folder / name).is_dir() and any((folder / name).iterdir()):
            raise InputError(str(folder / name), "it already holds files", remedy)
    for file in (_EXPERIMENT, *(f"{name}.csv" for name in names), *(f"{name}-truth.csv" for name in names)):
        if (folder / file).exists():
            raise InputError(str(folder / file), "it is there already", remedy)


@contextmanager
def _moved_when_complete(folder: Path) -> Iterator[Path]:
    """A folder inside ``folder``, whose files are moved there at the end: an interrupted simulation leaves none."""
    unfinished = folder / _UNFINISHED
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    try:
        yield unfinished
        for path in sorted(unfinished.iterdir(), key=lambda path: path.name == _EXPERIMENT):  # the file comes last
            if (folder / path.name).is_dir():  # an empty one
                (folder / path.name).rmdir()
            os.replace(path, folder / path.name)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


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
    check_new_dataset(folder, states)
    with _moved_when_complete(folder) as new:
        _write_images(new / "flats", reference.flats)
        _write_images(new / "darks", reference.darks)
        begin("writing the reference scan")
        _write_images(new / "reference", reference.counts)
        write_geometry(new / "reference.csv", reference.geometry)
        for name, (recording, truth) in states.items():
            begin(f"writing {name}")
            _write_images(new / name, recording.counts)
            write_geometry(new / f"{name}.csv", recording.geometry)
            write_motions(new / f"{name}-truth.csv", truth)
        (new / _EXPERIMENT).write_text(_experiment(beam, list(states), grid, initial), encoding="utf-8")
    return folder / _EXPERIMENT


def _write_images(folder: Path, images: NDArray[np.float32]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(counted(images)):
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
