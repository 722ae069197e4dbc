"""Wrong scans whose motions came out wrong without a word."""

from __future__ import annotations

import inspect
from pathlib import Path

import h5py
import numpy as np
from scipy.ndimage import gaussian_filter

import grainmotion as gm
from grainmotion.errors import InputError
from validation.accuracy.wrong_input.draft import Draft, Stack
from validation.accuracy.wrong_input.rows import row


@row(
    "silent",
    "rows run from the top, `first_row` not given",
    before="2.4 voxel, 7°, all converged",
    cause=r"error.*first_row",
    told_by="key `first_row`: no default; the message says how to find out",
)
def first_row_not_given(draft: Draft) -> None:
    """The key is left out."""
    del draft.geometry["first_row"]


@row(
    "silent",
    "sense of rotation wrong in both scans, cone beam",
    before="2.0 voxel, 9.4°, all converged",
    cause=r"error.*sense-of-rotation",
    told_by="`sense-of-rotation`, `angles_deg`",
    beams=("cone",),
)
def sense_of_both(draft: Draft) -> None:
    """All angles have the other sign."""
    draft.write_angles(-draft.laboratory.angles_deg)
    draft.tell_state_angles(-draft.laboratory.state_angles_deg)


@row(
    "silent",
    "the same, parallel beam: the mirror image fits as well",
    before="mirrored, all converged",
    cause=r"sense of rotation|sense-of-rotation",
    told_by="note `sense-of-rotation`: the data cannot tell; `inspection.png` shows the sense",
    beams=("parallel",),
)
def sense_of_both_parallel(draft: Draft) -> None:
    """All angles have the other sign."""
    sense_of_both(draft)


@row(
    "silent",
    "end point counted: {first = 0, last = 360, count = 60}, true step 6°",
    before="0.45–0.7 voxel, sd 0.011",
    cause=r"(error|warning).*(coinciding-views|end-point-counted)",
    told_by="`coinciding-views`, `last`",
)
def end_point_counted(draft: Draft) -> None:
    """The last view is told to be a turn after the first."""
    sense = draft.laboratory.draws["sense"]
    draft.geometry["angles_deg"] = {"first": 0.0, "last": 360.0 * sense, "count": draft.recipe.views}


@row(
    "silent",
    "one file of the series is missing, the count matches what is left",
    before="0.19 voxel, 0.37°",
    cause=r"(error|warning).*file-series",
    told_by="`file-series` names the gap",
)
def file_missing(draft: Draft) -> None:
    """A file is gone, and as many angles are told as there are files."""
    count, sense = draft.recipe.views, draft.laboratory.draws["sense"]
    draft.missing["reference"] = [int(draft.rng.integers(5, count - 5))]
    draft.geometry["angles_deg"] = {"first": 0.0, "last": float(sense * (360 - 360 / count)), "count": count - 1}


def nxtomo(draft: Draft, **records: tuple[Stack, str, float]) -> None:
    """The full scan as one NXtomo file; a record holds values of the projections, their unit, and what flats have."""
    frames = np.concatenate([draft.darks, draft.flats, draft.reference])
    keys = np.repeat([2, 1, 0], [len(draft.darks), len(draft.flats), len(draft.reference)])
    angles = draft.laboratory.angles_deg
    draft.reference = draft.reference[:0]
    draft.keys["reference"] = {"radiographs": "scan.nxs"}
    draft.keys["states"] |= {"flats": "flats/*.tif", "darks": "darks/*.tif"}
    del draft.geometry["angles_deg"]

    def write(folder: Path) -> None:
        with h5py.File(folder / "scan.nxs", "w") as file:
            entry = file.create_group("entry")
            entry.attrs["NX_class"] = "NXentry"
            entry["instrument/detector/data"] = frames
            entry["instrument/detector/image_key"] = keys
            others = np.zeros(np.count_nonzero(keys))
            entry["sample/rotation_angle"] = np.r_[others, angles]
            entry["sample/rotation_angle"].attrs["units"] = "degree"
            for name, (values, unit, of_flats) in records.items():
                before = np.full(len(others), of_flats)
                entry[name.replace("__", "/")] = np.r_[before, values]
                if unit:
                    entry[name.replace("__", "/")].attrs["units"] = unit

    draft.after.append(write)


@row(
    "silent",
    "stage rises by 4 voxels during the scan, recorded in NXtomo's `z_translation`",
    before="ignored: u_z off by 2.1 voxel, sd 0.04",
    cause="translations of the stage were used",
    told_by="used and told by `motors`",
)
def stage_rises(draft: Draft) -> None:
    """The recorded stage."""
    draft.use_recipe(rise=0.5)
    nxtomo(draft, sample__z_translation=(draft.laboratory.rise, "mm", 0.0))


def with_levels(draft: Draft, images: Stack, levels: Stack) -> Stack:
    """Counts of a beam of other levels."""
    dark = draft.darks.mean(axis=0)
    return np.clip(np.rint((images - dark) * levels[:, None, None] + dark), 0, 65535).astype(np.uint16)


@row(
    "silent",
    "beam's level differs by 5 % from view to view of the full scan",
    before="6 'grains' of 5, all converged",
    cause="each view was corrected by one factor",
    told_by="corrected and told by `beam-level`",
)
def beam_level(draft: Draft) -> None:
    """Independent levels."""
    levels = 1 + 0.05 * draft.rng.normal(size=len(draft.reference))
    draft.reference = with_levels(draft, draft.reference, levels)


@row(
    "silent",
    "two materials, one of 0.25–0.4 of the other's attenuation",
    before="2 of 5 grains in no table",
    cause=r"(error|warning).*unlabelled",
    told_by="`unlabelled`, `threshold`",
)
def two_materials(draft: Draft) -> None:
    """Every third stone is faint."""
    draft.use_recipe(faint=float(draft.rng.uniform(0.25, 0.4)))


@row(
    "silent",
    "five cubes turned by 50°",
    before="converged in mirror or neighbouring poses",
    cause=r"grain: (ambiguous|not-)",
    told_by="status `ambiguous`, or the right pose",
)
def cubes_50(draft: Draft) -> None:
    """A rotation at which the neighbouring pose is as near."""
    draft.use_recipe(cubes=50.0)
    draft.keys["track"] = {}


@row(
    "silent",
    "five cubes turned by 85°",
    before="converged in mirror or neighbouring poses",
    cause=r"grain: (ambiguous|not-)",
    told_by="status `ambiguous`, or the right pose",
)
def cubes_85(draft: Draft) -> None:
    """A rotation at which another pose is nearer."""
    draft.use_recipe(cubes=85.0)
    draft.keys["track"] = {}


DISTANCE_BEFORE = "0.13–0.78 voxel, 10–31 sd"

DISTANCE_TOLD = "`grain-scale`, `reference-geometry`; else not known from the data, see conventions.md"


def distance(factor: float) -> str:
    """What is wrong."""
    return f"distance source to axis wrong by {100 * (factor - 1):.0f} % in both scans"


def longer(draft: Draft, factor: float) -> None:
    """The source is told to be farther away."""
    near = draft.geometry["source_to_axis"]
    assert isinstance(near, float)
    draft.geometry["source_to_axis"] = round(near * factor, 4)


@row(
    "silent",
    distance(1.05),
    before=DISTANCE_BEFORE,
    cause=r"(error|warning).*distance",
    told_by=DISTANCE_TOLD,
    beams=("cone",),
)
def distance_5(draft: Draft) -> None:
    """As a ruler errs."""
    longer(draft, 1.05)


@row(
    "silent",
    distance(1.25),
    before=DISTANCE_BEFORE,
    cause=r"(error|warning).*distance",
    told_by=DISTANCE_TOLD,
    beams=("cone",),
)
def distance_25(draft: Draft) -> None:
    """Another position of the stage."""
    longer(draft, 1.25)


@row(
    "silent",
    "source distance wrong by 5 % in the later state only",
    before=DISTANCE_BEFORE,
    cause=r"(error|warning).*(grain-scale|state-geometry)",
    told_by="`grain-scale`",
    beams=("cone",),
    of_state=True,
)
def distance_of_state(draft: Draft) -> None:
    """The stage moved along the beam between the scans."""
    near = draft.geometry["source_to_axis"]
    assert isinstance(near, float)
    draft.state_geometry["source_to_axis"] = round(1.05 * near, 4)


def scattered(draft: Draft, share: float) -> None:
    """A share of the beam behind the sample is smooth, in both scans."""
    for name in ("reference", "state"):
        images = getattr(draft, name)
        dark, flat = draft.darks.mean(axis=0), draft.flats.mean(axis=0)
        part = (images - dark) / (flat - dark)
        smooth = gaussian_filter(part, (0, 16, 16), mode="nearest")
        counts = (part + share * smooth) / (1 + share) * (flat - dark) + dark
        setattr(draft, name, np.clip(np.rint(counts), 0, 65535).astype(np.uint16))


@row(
    "silent",
    "3 % scatter",
    before="sd too small by 2.4",
    cause="light that the sample scatters",
    told_by="note `hardening`, `[calibrate] hardening`",
)
def scatter_3(draft: Draft) -> None:
    """Little scatter."""
    scattered(draft, 0.03)


@row(
    "silent",
    "pixels twice as tall as told",
    before="sd too small by 6",
    cause=r"(error|warning).*pixels that are not square",
    told_by="`grain-sizes`: most grains are flat",
)
def tall_pixels(draft: Draft) -> None:
    """Rows binned by two, in both scans."""
    for name in ("reference", "state", "flats", "darks"):
        setattr(draft, name, pairs_of_rows(getattr(draft, name)))


def pairs_of_rows(images: Stack) -> Stack:
    """Mean of each two rows."""
    n, rows, columns = images.shape
    return np.rint(images.reshape(n, rows // 2, 2, columns).astype(float).mean(axis=2)).astype(np.uint16)


@row(
    "silent",
    "a setting that does not exist, `gm.TrackSettings(gainz=...)`, in each of six classes",
    before="ignored",
    cause="error.*unknown setting",
    told_by="refused, with the nearest name",
)
def settings_misspelled(draft: Draft) -> None:
    """A letter too many in the name of a setting, in all classes of settings; raises if each class refuses it."""
    refusals = []
    for kind in (
        gm.TrackSettings,
        gm.ReconstructSettings,
        gm.SegmentSettings,
        gm.PlanSettings,
        gm.CalibrateSettings,
        gm.HardeningSettings,
    ):
        names = list(inspect.signature(kind).parameters)
        name = str(draft.rng.choice(names))
        place, letter = int(draft.rng.integers(1, len(name) + 1)), chr(int(draft.rng.integers(97, 123)))
        wrong = name[:place] + letter + name[place:]
        try:
            kind(**{wrong: 1})
        except InputError as error:
            refusals.append(error)
    if len(refusals) == 6:
        raise refusals[0]
