"""The results of a run, read back for a notebook."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion.errors import InputError
from grainmotion.io.results import StoredReference, read_motions_h5, read_reference
from grainmotion.io.series_files import read_series
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.summary import Summarised, Summary, counted_rows, names_text
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import extract_grains
from grainmotion.segmentation.segment import Segmentation
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.sequences.series import Series

_REFERENCE, _MOTIONS, _SERIES_OF_RUN, _STAGES = "reference.h5", "motions.h5", "series.h5", "stages.json"


@dataclass(frozen=True, eq=False, repr=False)
class ResultsFolder(Summarised):
    """Results of a run.  The reference is read, and its grains are extracted, when they are first asked for.

    Attributes
    ----------
    folder : Path
        Where they are.
    motions : mapping of str to Motions
        Motions of each state by its name, in loading order; mm and radians.

    Examples
    --------
    >>> results = gm.read_results("results")
    >>> list(results.motions), results.volume.shape, len(results.grains)
    (['step-01', 'step-02'], (28, 36, 36), 6)
    """

    folder: Path
    motions: Mapping[str, Motions]

    @cached_property
    def reference(self) -> StoredReference:
        """The whole of ``reference.h5``."""
        return read_reference(self.folder / _REFERENCE)

    @property
    def volume(self) -> Volume:
        """The volume of the reference, 1/mm."""
        return self.reference.volume

    @property
    def labels(self) -> NDArray[np.int32]:
        """Labels of its grains ``(nz, ny, nx)``, 0 for none."""
        if self.reference.labels is None:
            raise InputError(str(self.folder / _REFERENCE), "it has no labels", "run at least until segment")
        return self.reference.labels

    @cached_property
    def grains(self) -> GrainSet:
        """The grains with their own voxels, extracted as the run did, by the settings that ``reference.h5`` tells."""
        segmentation = Segmentation(self.labels, self.reference.threshold, self.reference.border)
        return extract_grains(self.volume, segmentation, _segment_settings(self.folder / _REFERENCE))

    @cached_property
    def series(self) -> Series:
        """The motions of all states in loading order, with their times where the run was told them."""
        path = self.folder / _SERIES_OF_RUN
        stored = read_series(path) if path.is_file() else None
        times = {} if stored is None else dict(zip(stored.states, stored.times.tolist(), strict=True))
        return Series.of(self.motions, times)

    def _summary(self) -> Summary:
        return results_summary("Results", self.folder, self.motions)


def results_summary(
    title: str, folder: Path, motions: Mapping[str, Motions], more: tuple[tuple[str, str], ...] = ()
) -> Summary:
    """What the results of a run show of themselves: their folder, and the grains of each state by status."""
    rows = (("folder", str(folder)), *counted_rows({name: state.status_counts for name, state in motions.items()}))
    return Summary(title, f"{folder}; states {names_text(list(motions)) or 'none'}", (*rows, *more))


@checked_arguments
def read_results(folder: str | Path) -> ResultsFolder:
    """Read the results of a run: the reference, and the motions of each state.

    Parameters
    ----------
    folder : path
        ``[output] directory`` of the experiment file, or what was given as ``--out``.

    Returns
    -------
    ResultsFolder
        ``motions["NAME"]``, ``volume``, ``labels`` and ``grains``.

    Raises
    ------
    InputError
        If the folder holds no results, or a file of it is damaged.

    Examples
    --------
    >>> results = gm.read_results("results")
    >>> results.motions["step-01"].translations.shape
    (6, 3)
    """
    folder = Path(folder)
    if not (folder / _REFERENCE).is_file():
        fact = f"it holds no {_REFERENCE}" if folder.is_dir() else "no such folder"
        raise InputError(str(folder), fact, 'give the folder of the results of a run, such as "results"')
    names = _state_names(folder)
    return ResultsFolder(folder, {name: read_motions_h5(folder / name / _MOTIONS) for name in names})


def _state_names(folder: Path) -> list[str]:
    """Names of the states with motions, in the order in which they were tracked."""
    found = {path.parent.name for path in folder.glob(f"*/{_MOTIONS}")}
    try:
        stages = json.loads((folder / _STAGES).read_text(encoding="utf-8"))["stages"]
        told = [stage.removesuffix("/track") for stage in stages if stage.endswith("/track")]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        told = []  # no file, or an unreadable one: the names in order
    return [name for name in dict.fromkeys((*told, *sorted(found))) if name in found]


def _segment_settings(path: Path) -> SegmentSettings:
    """Settings of the segmentation, as the file tells them; the defaults for files of older versions."""
    with h5py.File(path) as file:
        told = json.loads(str(file.attrs.get("settings", "{}"))).get("segment", {})
    return SegmentSettings(**told)
