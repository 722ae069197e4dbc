"""The experiment file: one TOML with the measurements, where their files are, and the settings of every stage.

Every table is a record below; the tables of the stages are the settings of the Python functions themselves, so
that the keys of the file and the keywords of Python are one list.  Paths start at the file's folder.
An unknown key is an error that names the nearest known one.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from grainmotion._arguments import checked_arguments
from grainmotion.backends.device import DeviceName
from grainmotion.calibration.settings import ReferenceSettings, ScannerSettings
from grainmotion.diagnosis.settings import CheckSettings
from grainmotion.errors import InputError
from grainmotion.experiment.config_errors import input_error
from grainmotion.experiment.inherited_keys import TOLD_BY_FILES, with_inherited_keys
from grainmotion.experiment.scan_tables import RESERVED_STATE_NAMES, ReferenceTable, StateTable, Table, WatchTable
from grainmotion.experiment.watched_folders import matched_folders
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.io.files import checked_file
from grainmotion.io.scanners.identify import scanner_files_beside
from grainmotion.io.spam_table import About
from grainmotion.io.text import read_text
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.model.summary import Summarised, Summary, names_text, shape_text, value_text
from grainmotion.planning.plan import PlanSettings
from grainmotion.reconstruction.reconstruct import ReconstructSettings
from grainmotion.reconstruction.settings import Outline
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.tracking.track import TrackSettings

Export = Literal["vtk", "spam", "tiff", "ome-zarr", "mechanics", "dem"]
VolumeFormat = Literal["tiff", "hdf5", "ome-zarr"]
SeriesFormat = Literal["h5", "csv", "parquet"]


class VolumeTable(Table):
    """The grid of voxels; by default the field of view, with voxels of one pixel at the axis."""

    shape: tuple[int, int, int] | None = Field(default=None, description="voxels along z, y, x")
    voxel_size: float | None = Field(
        default=None, gt=0, description="mm; that of a given volume's file unless it is given here"
    )
    center: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="mm, x y z; a volume written by grainmotion tells its own"
    )
    outline: Outline | None = Field(
        default=None,
        description="radius of the sample's outline about the grid's axis, mm: the grid is grown to hold it; \"auto\" "
        '(default): found from the radiographs; "grid": the grid is not grown',
    )


class OutputTable(Table):
    """What to write, and where."""

    directory: str = Field(default="results", description="folder of the results, from the file's own folder")
    rebuild: bool = Field(default=False, description="write the moved grains of each state as a volume with labels")
    volumes: VolumeFormat = Field(
        default="tiff",
        description='files of the rebuilt volumes: "tiff" with voxel size, labels in a second file; "hdf5"; '
        '"ome-zarr" with coarser levels, for large ones',
    )
    exports: list[Export] = Field(
        default=[],
        description='files for other software: "vtk", "spam"; "tiff": reference and rebuilt volumes with labels, for '
        'Fiji and napari; "ome-zarr": reference volume and labels, for napari; '
        '"mechanics": strains, contacts, fabric, void ratios; "dem": shapes, inertia and poses for DEM codes',
    )
    spam_about: About = Field(
        default="centroid",
        description='the point whose displacement files for spam give: of the label, "centroid" for spam-moveLabels '
        '-com and strains, or the middle of its bounding box, "box", for a start of spam-ddic',
    )
    series: list[SeriesFormat] = Field(
        default=["h5", "csv"],
        description='formats of the table of all states, series.h5, ...: "h5", "csv", "parquet" (needs pyarrow)',
    )


class ExperimentFile(Table):
    """All tables of the file."""

    reference: ReferenceTable
    volume: VolumeTable = Field(default_factory=VolumeTable)
    check: CheckSettings = Field(default_factory=CheckSettings)
    calibrate: ScannerSettings = Field(default_factory=ScannerSettings)
    reconstruct: ReconstructSettings = Field(default_factory=ReconstructSettings)
    segment: SegmentSettings = Field(default_factory=SegmentSettings)
    track: TrackSettings = Field(default_factory=TrackSettings)
    plan: PlanSettings = Field(default_factory=PlanSettings)
    mechanics: MechanicsSettings = Field(default_factory=MechanicsSettings)
    states: list[StateTable] = Field(default_factory=list)
    watch: WatchTable | None = None
    output: OutputTable = Field(default_factory=OutputTable)
    dem: DemSettings = Field(default_factory=DemSettings)


@dataclasses.dataclass(frozen=True, repr=False)
class Experiment(Summarised):
    """A valid experiment file.

    Attributes
    ----------
    path : Path
        The file.
    tables : ExperimentFile
        Its content.
    of_folders : tuple of str
        Names of the states that ``[watch] folders`` gave.
    left_out : tuple of str
        Sentences on folders that match it and cannot be states.
    """

    path: Path
    tables: ExperimentFile
    of_folders: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """Folder of the file, where relative paths start."""
        return self.path.parent

    @property
    def output(self) -> Path:
        """Folder of the results unless another is given."""
        return self.folder / self.tables.output.directory

    @property
    def reference_settings(self) -> ReferenceSettings:
        """How the reference state is made: the tables ``[calibrate]``, ``[reconstruct]`` and ``[segment]``."""
        return ReferenceSettings(self.tables.calibrate, self.tables.reconstruct, self.tables.segment)

    def with_states(self, states: Sequence[StateTable]) -> Experiment:
        """The same experiment with other states."""
        return dataclasses.replace(self, tables=self.tables.model_copy(update={"states": list(states)}))

    def checked(self, *, force: bool, try_fixes: bool) -> Experiment:
        """The same experiment, with checks that are not to stop it, or whose fixes are to be applied."""
        old = self.tables.check
        check = dataclasses.replace(old, force=force or old.force, try_fixes=try_fixes or old.try_fixes)
        return dataclasses.replace(self, tables=self.tables.model_copy(update={"check": check}))

    def on(self, device: DeviceName) -> Experiment:
        """The same experiment, with reconstruction and tracking on one device."""
        reconstruct = dataclasses.replace(self.tables.reconstruct, device=device)
        track = dataclasses.replace(self.tables.track, device=device)
        tables = self.tables.model_copy(update={"reconstruct": reconstruct, "track": track})
        return dataclasses.replace(self, tables=tables)

    def _summary(self) -> Summary:
        states = [state.name for state in self.tables.states]
        rows = [("file", str(self.path)), ("states", names_text(states) or "none"), ("results", str(self.output))]
        reference, volume = self.tables.reference, self.tables.volume
        rows += [
            ("reference", value_text(reference.volume if reference.radiographs is None else reference.radiographs))
        ]
        if volume.shape is not None and volume.voxel_size is not None:
            rows.append(("volume", f"{shape_text(volume.shape)} voxels (z, y, x) of {volume.voxel_size:.5g} mm"))
        rows += [("left out", sentence) for sentence in self.left_out]
        return Summary("Experiment", f"{self.path}; states {names_text(states) or 'none'}", tuple(rows))


@checked_arguments
def read_experiment(path: str | Path) -> Experiment:
    """Read and validate an experiment file.

    Parameters
    ----------
    path : path
        The TOML file; ``docs/experiment.md`` lists its keys.

    Returns
    -------
    Experiment
        The file's tables, with a default for each key that it leaves out, and a state for each folder that matches
        ``[watch] folders``.  No other file is read.

    Raises
    ------
    InputError
        If the file is missing or no TOML, or a key is unknown, missing or has an invalid value.

    Examples
    --------
    >>> experiment = gm.read_experiment("experiment.toml")
    >>> [state.name for state in experiment.tables.states], experiment.tables.volume.voxel_size
    (['step-01', 'step-02'], 0.1)
    """
    path = checked_file(path)
    try:
        data = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), f"malformed TOML: {error}", _toml_remedy(str(error))) from error
    try:
        data = with_inherited_keys(data)
        try:
            tables = ExperimentFile.model_validate(data)
        except ValidationError as error:
            raise _with_scanners_file(input_error(error, ExperimentFile, data), data, path.parent) from error
        _check_states(tables)
        experiment = Experiment(path, tables)
        if tables.watch is not None:
            experiment = _with_folders(experiment, tables.watch)
            _check_states(experiment.tables)
    except InputError as error:
        raise InputError(f"{path}: {error.where}", error.fact, error.remedy) from error
    return experiment


def _with_folders(experiment: Experiment, watched: WatchTable) -> Experiment:
    """The experiment with a state for each folder that can be one."""
    found, left_out = list[StateTable](), list[str]()
    for folder in watched_folders(experiment):
        try:
            names = [state.name for state in (*experiment.tables.states, *found)]
            found.append(watched.state(folder, names))
        except InputError as error:
            left_out.append(error.fact)
    of_folders = tuple(state.name for state in found)
    experiment = experiment.with_states([*experiment.tables.states, *found])
    return dataclasses.replace(experiment, of_folders=of_folders, left_out=tuple(left_out))


def watched_folders(experiment: Experiment) -> list[Path]:
    """Folders that match ``[watch] folders`` by now, but for those of whose name a state is told."""
    watched = experiment.tables.watch
    if watched is None:
        return []
    told = {state.name for state in experiment.tables.states} - set(experiment.of_folders)
    folders = matched_folders(watched.folders, experiment.folder, experiment.output)
    return [folder for folder in folders if folder.name not in told]


def _with_scanners_file(error: InputError, data: Mapping[str, object], folder: Path) -> InputError:
    """The error about missing keys of a circle, with the scanner's file beside the images, which tells them."""
    reference = data.get("reference")
    named = reference.get("radiographs") if isinstance(reference, dict) else None
    names = [named] if isinstance(named, str) else named if isinstance(named, list) else []
    beside = [f for name in names if isinstance(name, str) for f in scanner_files_beside(name, folder)]
    if not beside or not any(f"geometry.{key}: it is missing" in str(error) for key in TOLD_BY_FILES):
        return error
    remedy = f'name the scanner\'s file, which tells it: reference.radiographs = "{beside[0]}"; or {error.remedy}'
    return InputError(error.where, error.fact, remedy)


def _toml_remedy(fact: str) -> str:
    """What to do about TOML that cannot be parsed."""
    if "\\" in fact or "hex" in fact.lower():
        return "write paths with / instead of \\, on Windows too, or between single quotes: 'C:\\data\\ref'"
    if "Invalid value" in fact or "Expected newline" in fact or "Unclosed" in fact:
        return 'correct it there; numbers have a decimal point and no unit, text has quotation marks: kind = "counts"'
    return "correct it there"


def _check_states(tables: ExperimentFile) -> None:
    names = [s.name.lower() for s in tables.states]
    for name in names:
        if name in RESERVED_STATE_NAMES:
            raise InputError("states", f"a state cannot be called '{name}': a result file has this name", "rename it")
        if names.count(name) > 1:
            raise InputError("states", f"the name '{name}' is given twice", "give each state its own name")
    told = [s for s in tables.states if s.time is not None]
    for before, state in pairwise(told):
        if before.time is not None and state.time is not None and state.time <= before.time:
            fact = f"{state.time:g} s, not after the {before.time:g} s of state '{before.name}' before it"
            remedy = "give the states in loading order, with seconds since the reference scan"
            raise InputError(f"states '{state.name}'.time", fact, remedy)
