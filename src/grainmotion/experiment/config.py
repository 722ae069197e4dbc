"""The experiment file: one TOML with the measurements, where their files are, and the settings of every stage.

Every table is a record below; the tables of the stages are the settings of the Python functions themselves, so
that the keys of the file and the keywords of Python are one list.  Paths start at the file's folder.
An unknown key is an error that names the nearest known one.
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from grainmotion._typing import Beam, Kind
from grainmotion._validation import validated
from grainmotion.backends.device import DeviceName
from grainmotion.calibration.settings import ReferenceSettings, ScannerSettings
from grainmotion.diagnosis.hypotheses import HYPOTHESES
from grainmotion.diagnosis.settings import CheckSettings
from grainmotion.errors import InputError
from grainmotion.experiment.config_errors import input_error
from grainmotion.experiment.inherited_keys import with_inherited_keys
from grainmotion.experiment.watched_folders import FOLDER_MARK, matched_folders, with_folder
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.io.files import checked_file
from grainmotion.io.spam_table import About
from grainmotion.io.text import read_text
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.planning.plan import PlanSettings
from grainmotion.reconstruction.reconstruct import ReconstructSettings
from grainmotion.reconstruction.settings import Outline
from grainmotion.segmentation.settings import SegmentSettings
from grainmotion.tracking.track import TrackSettings

RESERVED_STATE_NAMES = (
    "reference.h5", "reconstruction.h5", "report.html", "stages.json", "reference.tif", "reference.vti",
    "reference_labels.tif", "reference_grains.vtp", "reference_surfaces.vtp", "grains.pvd", "surfaces.pvd",
    "reference.ome.zarr",
    "beam_level.json", "calibration.json", "checks.json", "checks-grains.json", "checks-volume.json", "run.log",
    "series.h5", "series.csv", "series.parquet", "watch.html", "datapackage.json",
    "reference_contacts.csv", "reference_void_ratio.csv", "reference_mechanics.json", "dem",
)  # fmt: skip
Export = Literal["vtk", "spam", "tiff", "ome-zarr", "mechanics", "dem"]
VolumeFormat = Literal["tiff", "hdf5", "ome-zarr"]
SeriesFormat = Literal["h5", "csv", "parquet"]


def _as_list(value: object) -> object:
    return [value] if isinstance(value, str) else value


Files = Annotated[list[str], BeforeValidator(_as_list), Field(min_length=1)]
"""A path, a glob, ``"file.h5::/path"``, or a list of those."""


def _known_fix(name: str) -> str:
    if name not in HYPOTHESES:
        raise ValueError(f"unknown; known names are {', '.join(HYPOTHESES)}")
    return name


Fix = Annotated[str, AfterValidator(_known_fix)]
"""Name of a mistake in the geometry, as in `grainmotion.diagnosis.hypotheses`."""


def _usable_name(name: str) -> str:
    if re.fullmatch(r"[^\W_][^/\\:*?\"<>|\x00-\x1f]*", name) is None:
        raise ValueError('it names a folder: begin with a letter or digit, and use none of / \\ : * ? " < > |')
    return name


StateName = Annotated[str, AfterValidator(_usable_name)]
"""Name of a state and of its folder: letters of any alphabet."""

Direction = Literal["x", "-x", "y", "-y", "z", "-z"]
"""Direction in the lab frame: x to higher columns at an angle of 0, y along the beam, z up the rotation axis."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


@validated
class Air:
    """Where the radiographs show only air, for one factor a view.  Give one of the two."""

    margin: Annotated[int | None, Field(gt=0, description="columns at the left and as many at the right")] = None
    region: Annotated[tuple[int, int, int, int] | None, Field(description="row0, row1, column0, column1")] = None


class AngleRange(_Table):
    """Equally spaced angles, first and last included, degrees."""

    first: float = Field(description="first angle, degrees")
    last: float = Field(description="last angle, degrees")
    count: int = Field(gt=0, description="number of angles")


class Circular(_Table):
    """A circular scan, as `Geometry.cone` and `Geometry.parallel`; a state's table inherits the reference's keys.

    What a scanner's file tells needs no key; a key that is given overrides the file.
    """

    beam: Beam | None = Field(default=None, description='"cone" or "parallel"')
    source_to_axis: float | None = Field(default=None, gt=0, description="mm, cone beam only")
    source_to_detector: float | None = Field(default=None, gt=0, description="mm, cone beam only")
    pixel_size: float | None = Field(gt=0, description="mm")
    file: str | None = Field(
        default=None, description="file with the views or the numbers of the scan; keys override it"
    )
    angles_deg: list[float] | AngleRange | str | None = Field(
        default=None,
        description="list, {first, last, count}, a text file with one angle a line or with file names and angles, "
        '"file.h5::/path", or "names": those in the names of the radiographs',
    )
    first: float | None = Field(default=None, description="first angle, degrees, with step, or with last and count")
    step: float | None = Field(
        default=None, description="from one radiograph to the next, degrees, with first; as many as radiographs"
    )
    last: float | None = Field(default=None, description="last angle, degrees, included")
    count: int | None = Field(default=None, gt=0, description="number of angles, missing files included")
    detector_offset: tuple[float, float] = Field(default=(0.0, 0.0), description="along u and v, mm")
    detector_tilts_deg: tuple[float, float, float] = Field(default=(0.0, 0.0, 0.0), description="about x, y, z at 0")
    axis_offset: float = Field(default=0.0, description="of the axis along u, mm")
    axis_tilt_deg: tuple[float, float] = Field(default=(0.0, 0.0), description="about x and y at 0")
    first_row: Literal["bottom", "top"] | None = Field(
        description='where row 0 of the images lies: "top" of the sample (most camera files) or "bottom"; no default'
    )


class ScanTable(_Table):
    """Radiographs, with everything needed to turn them into line integrals."""

    radiographs: Files | None = Field(default=None, description="TIFF, .npy, HDF5 path, or one file of a scanner")
    flats: Files | None = Field(default=None, description="images of the open beam; averaged")
    darks: Files | None = Field(default=None, description="images without beam; averaged; without them the dark is 0")
    kind: Kind | None = Field(default=None, description='"counts" (default), "transmission" or "line-integrals"')
    geometry: str | Circular | None = Field(default=None, description="file with one row a view, or a table")
    beam: Beam | None = Field(default=None, description='"cone" (default) or "parallel"')
    views: str | list[int] | None = Field(
        default=None,
        description='radiographs to use, "start:stop:step" or a list; the geometry holds these or all of them',
    )
    air: Air | None = Field(default=None, description="where the radiographs show only air, for one factor a view")
    white_level: float | None = Field(
        default=None, gt=0, description="count of the open beam, if the scanner has divided the counts by its flats"
    )
    saturation: float | None = Field(default=None, gt=0, description="count from which a pixel is saturated")
    motors: Literal[False] | tuple[Direction, Direction, Direction] | None = Field(
        default=None,
        description="whither x_, y_ and z_translation of an NXtomo file carry the sample, in the lab frame "
        '(["x", "y", "z"] unless given); false: they are not used',
    )
    fixes: list[Fix] = Field(
        default=[], description="mistakes in the geometry to undo, by the names that a check gave, in turn"
    )


class ReferenceTable(ScanTable):
    """The full scan of the initial state, or its volume reconstructed by other software."""

    volume: Files | None = Field(
        default=None, description="a volume of another program, 1/mm; docs/volumes.md lists formats"
    )
    labels: Files | None = Field(default=None, description="grains in that volume, whole numbers, 0 = none")


class VolumeTable(_Table):
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


class StateTable(ScanTable):
    """The few radiographs of one later state."""

    name: StateName = Field(description="also its folder's name")
    initial: str = Field(
        default="previous",
        description='"previous" (or the extrapolation of the last two states where that fits better), "reference", or '
        "a motions.csv or spam .tsv",
    )
    initial_about: About | None = Field(
        default=None,
        description='of a spam .tsv: the point whose displacement it gives, the position in its row ("centroid") or '
        'the middle of the label\'s bounding box ("box"); by default as its columns tell: "box" for those of spam-ddic',
    )
    time: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="of its radiographs, seconds since the reference scan"
    )


class WatchTable(ScanTable):
    """Folders that become states as they appear, each of its folder's name; `run` takes those that are there.

    The other keys are those of a state; in names of files {folder} stands for the folder.
    """

    folders: str = Field(description='pattern of the folders, such as "steps/*", from the file\'s own folder')
    radiographs: Files = Field(default=[FOLDER_MARK], description="of each state: all images in its folder by default")
    count: int | None = Field(
        default=None, gt=0, description="radiographs of a complete state, where the geometry does not tell their number"
    )

    def state(self, folder: Path) -> StateTable:
        """The state of one folder."""
        told = {name: getattr(self, name) for name in ScanTable.model_fields}
        for name in ("radiographs", "flats", "darks"):
            told[name] = None if told[name] is None else with_folder(told[name], folder)
        if isinstance(self.geometry, str):
            told["geometry"] = with_folder([self.geometry], folder)[0]
        elif isinstance(self.geometry, Circular) and isinstance(self.geometry.angles_deg, str):
            angles = with_folder([self.geometry.angles_deg], folder)[0]
            told["geometry"] = self.geometry.model_copy(update={"angles_deg": angles})
        if folder.name.lower() in RESERVED_STATE_NAMES:
            fact = f"the folder {folder} cannot be a state: a result file has this name"
            raise InputError("watch.folders", fact, "rename it, or narrow the pattern")
        try:
            return StateTable(name=folder.name, **told)
        except ValidationError as error:
            fact = f"the folder {folder} cannot be a state: {error.errors()[0]['msg']}"
            raise InputError("watch.folders", fact, "rename it, or narrow the pattern") from error


class OutputTable(_Table):
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


class ExperimentFile(_Table):
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
    states: list[StateTable] = []
    watch: WatchTable | None = None
    output: OutputTable = Field(default_factory=OutputTable)
    dem: DemSettings = Field(default_factory=DemSettings)


@dataclasses.dataclass(frozen=True)
class Experiment:
    """A valid experiment file.

    Attributes
    ----------
    path : Path
        The file.
    tables : ExperimentFile
        Its content.
    of_folders : tuple of str
        Names of the states that ``[watch] folders`` gave.
    """

    path: Path
    tables: ExperimentFile
    of_folders: tuple[str, ...] = ()

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
            raise input_error(error, ExperimentFile, data) from error
        _check_states(tables)
        experiment = Experiment(path, tables)
        if tables.watch is not None:
            found = [tables.watch.state(folder) for folder in watched_folders(experiment)]
            experiment = experiment.with_states([*tables.states, *found])
            experiment = dataclasses.replace(experiment, of_folders=tuple(state.name for state in found))
            _check_states(experiment.tables)
    except InputError as error:
        raise InputError(f"{path}: {error.where}", error.fact, error.remedy) from error
    return experiment


def watched_folders(experiment: Experiment) -> list[Path]:
    """Folders that match ``[watch] folders`` by now, but for those of whose name a state is told."""
    watched = experiment.tables.watch
    if watched is None:
        return []
    told = {state.name for state in experiment.tables.states} - set(experiment.of_folders)
    folders = matched_folders(watched.folders, experiment.folder, experiment.output)
    return [folder for folder in folders if folder.name not in told]


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
