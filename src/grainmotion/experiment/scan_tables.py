"""Tables of the experiment file about scans: the reference, the states, the states to watch for, and circular scans."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from grainmotion._typing import Beam, Kind
from grainmotion._validation import validated
from grainmotion.diagnosis.hypotheses import HYPOTHESES
from grainmotion.errors import InputError
from grainmotion.experiment.watched_folders import FOLDER_MARK, with_folder
from grainmotion.io.spam_table import About

RESERVED_STATE_NAMES = (
    "reference.h5", "reconstruction.h5", "report.html", "stages.json", "reference.tif", "reference.vti",
    "reference_labels.tif", "reference_grains.vtp", "reference_surfaces.vtp", "grains.pvd", "surfaces.pvd",
    "reference.ome.zarr",
    "beam_level.json", "calibration.json", "checks.json", "checks-grains.json", "checks-grid.json",
    "checks-volume.json", "run.log", "series.h5", "series.csv", "series.parquet", "watch.html", "datapackage.json",
    "reference_contacts.csv", "reference_body_contacts.csv", "reference_void_ratio.csv",
    "reference_mechanics.json", "dem",
)  # fmt: skip
"""Names of result files and folders, which a state cannot have."""


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


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


@validated
class Air:
    """Where the radiographs show only air, for one factor a view.  Give one of the two.

    Examples
    --------
    >>> gm.Air(margin=8)
    Air(margin=8, region=None)
    """

    margin: Annotated[int | None, Field(gt=0, description="columns at the left and as many at the right")] = None
    region: Annotated[tuple[int, int, int, int] | None, Field(description="row0, row1, column0, column1")] = None


def _as_plain_list(views: object) -> object:
    return views.tolist() if isinstance(views, np.ndarray) else list(views) if isinstance(views, range) else views


Views = Annotated[
    str | list[int] | None,
    BeforeValidator(_as_plain_list),
    Field(description='radiographs to use, "start:stop:step" or a list; the geometry holds these or all of them'),
]
WhiteLevel = Annotated[
    float | None,
    Field(gt=0, description="count of the open beam, if the scanner has divided the counts by its flats"),
]
Saturation = Annotated[float | None, Field(gt=0, description="count from which a pixel is saturated")]
Motors = Annotated[
    Literal[False] | tuple[Direction, Direction, Direction] | None,
    Field(
        description="directions in which x_translation, y_translation and z_translation of an NXtomo file move the "
        'sample, in the lab frame (["x", "y", "z"] unless given); false: they are not used'
    ),
]
Fixes = Annotated[
    list[Fix], Field(description="mistakes in the geometry to undo, by the names that a check gave, in turn")
]


AirPlace = Annotated[Air | None, Field(description="where the radiographs show only air, for one factor a view")]


@validated
class ScanSettings:
    """How the radiographs of a scan are read: the keys of its table that `read_scan` has no argument for.

    Examples
    --------
    >>> every_other = gm.ScanSettings(views="::2", saturation=65_000)
    """

    views: Views = None
    air: AirPlace = None
    white_level: WhiteLevel = None
    saturation: Saturation = None
    motors: Motors = None
    fixes: Fixes = field(default_factory=list)


class AngleRange(Table):
    """Equally spaced angles, first and last included, degrees."""

    first: float = Field(description="first angle, degrees")
    last: float = Field(description="last angle, degrees")
    count: int = Field(gt=0, description="number of angles")


class Circular(Table):
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


class ScanTable(Table):
    """Radiographs, with everything needed to turn them into line integrals."""

    radiographs: Files | None = Field(default=None, description="TIFF, .npy, HDF5 path, or one file of a scanner")
    flats: Files | None = Field(default=None, description="images of the open beam; averaged")
    darks: Files | None = Field(default=None, description="images without beam; averaged; without them the dark is 0")
    kind: Kind | None = Field(default=None, description='"counts" (default), "transmission" or "line-integrals"')
    geometry: str | Circular | None = Field(default=None, description="file with one row a view, or a table")
    beam: Beam | None = Field(default=None, description='"cone" (default) or "parallel"')
    views: Views = None
    air: AirPlace = None
    white_level: WhiteLevel = None
    saturation: Saturation = None
    motors: Motors = None
    fixes: Fixes = []


class ReferenceTable(ScanTable):
    """The full scan of the initial state, or its volume reconstructed by other software."""

    volume: Files | None = Field(
        default=None, description="a volume of another program, 1/mm; docs/volumes.md lists formats"
    )
    labels: Files | None = Field(default=None, description="grains in that volume, whole numbers, 0 = none")


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

    def state(self, folder: Path, taken: Sequence[str] = ()) -> StateTable:
        """The state of one folder; ``taken`` are the names of others.

        Raises an `InputError` that says why if the folder cannot be one.
        """
        if folder.name.lower() in [name.lower() for name in taken]:
            fact = f"the folder {folder} is left out: a state is called '{folder.name}' already"
            raise InputError("watch.folders", fact, "rename it")
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
            reason = error.errors()[0]["msg"].removeprefix("Value error, ")
            fact = f"the folder {folder} cannot be a state: {reason}"
            raise InputError("watch.folders", fact, "rename it, or narrow the pattern") from error
