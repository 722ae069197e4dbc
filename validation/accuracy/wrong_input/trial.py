"""Trial: one input of one seed, written as files, run, and judged; its verdict is kept on disk."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import asdict
from functools import cache
from pathlib import Path

from grainmotion.errors import InputError
from validation.accuracy.page import PAGE
from validation.accuracy.wrong_input.draft import Draft
from validation.accuracy.wrong_input.good_cases import GOOD_CASES
from validation.accuracy.wrong_input.laboratory import VOXEL, Recipe
from validation.accuracy.wrong_input.rows import ROWS
from validation.accuracy.wrong_input.verdicts import Verdict, judged, temporary_folder
from validation.common.cache import source_digest

_folders = ExitStack()  # removed when the process ends


def wrong(name: str, seed: int) -> Verdict:
    """The verdict on a row of `ROWS`."""
    draft = Draft.of(Recipe(seed))
    try:
        ROWS[name].make(draft)
    except InputError as error:  # the mistake is in a call, not in a file
        return Verdict([f"error: {error}"], True, 0, 0, 0, 0, (0.0, 0.0), 0.0)
    if ROWS[name].of_state:
        return judged(draft.write_state(right_folder(seed), name), draft.laboratory.truth, VOXEL)
    with temporary_folder() as folder:
        return judged(draft.write(Path(folder)), draft.laboratory.truth, VOXEL)


def good(name: str, seed: int) -> Verdict:
    """The verdict on one of `GOOD_CASES`."""
    with temporary_folder() as folder:
        return judged(*GOOD_CASES[name].write(seed, Path(folder)))


@cache
def right_folder(seed: int) -> Path:
    """The right experiment of a seed and its results, whose reference all inputs that are wrong in the state share."""
    folder = Path(_folders.enter_context(temporary_folder()))
    judged(Draft.of(Recipe(seed)).write(folder), Draft.of(Recipe(seed)).laboratory.truth, VOXEL)
    return folder


def store(kind: str, name: str, seed: int) -> Path:
    """File of a verdict; remove it to judge the input anew."""
    return PAGE.cache / "wrong_input" / kind / name / f"{seed}.json"


def save(path: Path, verdict: Verdict) -> None:
    """Keep a verdict, with the digest of the package that gave it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(verdict) | {"source": package_digest()}, indent=1))


def package_digest() -> str:
    """Digest of all of the package as it is now."""
    return source_digest("")


def load(path: Path) -> Verdict:
    """A verdict that was kept."""
    return Verdict(**json.loads(path.read_text()))
