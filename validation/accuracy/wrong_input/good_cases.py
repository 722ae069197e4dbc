"""Experiments that are right, though some are odd: nothing but notes should be told of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grainmotion.model.motions import Motions
from grainmotion.simulate import HARD_CASES, LABORATORY_CASES, LATER_ANGLES_DEG, hard_case
from grainmotion.workflow.dataset import write_dataset
from validation.accuracy.wrong_input.draft import Draft, write_hdf5
from validation.accuracy.wrong_input.laboratory import Recipe

Written = tuple[Path, Motions, float]
"""The experiment file, the true motions, and the size of a voxel, mm."""


@dataclass(frozen=True)
class GoodCase:
    """An experiment that is right.

    ``write`` puts the files of a seed in a folder; ``seeds`` are the seeds of its samples.
    """

    name: str
    text: str
    write: Callable[[int, Path], Written]
    seeds: int


def _hard(name: str) -> Callable[[int, Path], Written]:
    def write(seed: int, folder: Path) -> Written:
        made = hard_case(name, seed)
        angles = LATER_ANGLES_DEG[4]
        states = {"load": (made.state_counts(angles), made.motions)}
        grid = made.case.scanner.grid
        path = write_dataset(folder, made.reference_counts(), states, grid, initial="reference")
        return path, made.motions, grid.voxel_size

    return write


def _laboratory(change: Callable[[Draft], None] | None = None, **recipe: object) -> Callable[[int, Path], Written]:
    """A laboratory, with default settings."""

    def write(seed: int, folder: Path) -> Written:
        draft = Draft.of(replace(Recipe(seed), **recipe), {})  # type: ignore[arg-type]
        if change is not None:
            change(draft)
        return draft.write(folder), draft.laboratory.truth, float(str(draft.keys["volume"]["voxel_size"]))

    return write


def _half_turn(seed: int, folder: Path) -> Written:
    """Views over half a turn, a little more in a cone beam."""
    return _laboratory(span_deg=180.0 if seed % 2 else 200.0)(seed, folder)


def _in_hdf5(draft: Draft) -> None:
    """All images in one HDF5 file."""
    stacks = draft.stacks
    draft.reference, draft.state, draft.flats, draft.darks = (s[:0] for s in stacks.values())
    draft.after.append(lambda folder: write_hdf5(folder / "scan.h5", **stacks))
    draft.keys["reference"] = {
        "radiographs": "scan.h5::/reference",
        "flats": "scan.h5::/flats",
        "darks": "scan.h5::/darks",
    }
    draft.keys["states"]["radiographs"] = "scan.h5::/load"


def _binned_state(draft: Draft) -> None:
    """The state binned by two, with flats and darks of its own, and told so."""
    own = {name: binned(getattr(draft, name)) for name in ("flats", "darks")}
    draft.state = binned(draft.state)
    draft.state_geometry["pixel_size"] = 2 * draft.laboratory.pixel_size
    draft.after.append(lambda folder: write_hdf5(folder / "own.h5", **own))
    draft.keys["states"] |= {"flats": "own.h5::/flats", "darks": "own.h5::/darks"}


def binned(images: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Mean of each 2 × 2 pixels."""
    n, rows, columns = images.shape
    return np.rint(images.reshape(n, rows // 2, 2, columns // 2, 2).astype(float).mean(axis=(2, 4))).astype(np.uint16)


def _given(draft: Draft) -> None:
    """A right volume with labels instead of the full scan."""
    draft.give_volume()


FEW, MORE = 4, 5
SINGLE_FLAWS = tuple(name for name in HARD_CASES if name not in LABORATORY_CASES)
"""Hard cases; what a run says of laboratory samples is measured in `validation.accuracy.laboratory`."""
GOOD_CASES = {
    case.name: case
    for case in (
        *(GoodCase(name, HARD_CASES[name].summary, _hard(name), MORE) for name in SINGLE_FLAWS),
        GoodCase("plain", "a plain laboratory scan", _laboratory(), 20),
        GoodCase("half-turn", "views over 180° (parallel beam) or 200° (cone beam)", _half_turn, FEW),
        GoodCase("volume", "a volume and labels of other software, right", _laboratory(_given), 20),
        GoodCase("dim", "2,500 photons a pixel", _laboratory(photons=2_500.0), FEW),
        GoodCase("bright", "60,000 photons a pixel", _laboratory(photons=60_000.0), FEW),
        GoodCase("sizes", "stones 25 % larger or smaller than the mean", _laboratory(size_spread=0.25), FEW),
        GoodCase("cell", "in a cell that stays in place", _laboratory(around="cell"), FEW),
        GoodCase("platens", "between two platens that stay in place", _laboratory(around="platens"), FEW),
        GoodCase("beam", "the later state 15 % brighter than its flats", _laboratory(state_beam=1.15), FEW),
        GoodCase("two-views", "a state of two views", _laboratory(state_views=(22.5, 112.5)), FEW),
        GoodCase(
            "six-views", "a state of six views", _laboratory(state_views=(0.0, 30.0, 60.0, 90.0, 120.0, 150.0)), FEW
        ),
        GoodCase("binned-state", "the state binned by two and told so", _laboratory(_binned_state), FEW),
        GoodCase("hdf5", "all images in one HDF5 file", _laboratory(_in_hdf5), FEW),
    )
}
"""By name."""
