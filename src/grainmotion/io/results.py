"""Results of a run: ``reference.h5`` and, per state, ``motions.h5``.

``reference.h5`` holds the datasets ``volume`` (1/mm, ``[z, y, x]``; attributes ``voxel_size`` and
``center``, mm), ``residuals`` (the relative residual of Eq. 23 after each sweep), ``labels`` (0 = no
grain; attributes ``threshold``, 1/mm, ``border``, and of the phases that were found ``phase_kinds``,
``phase_attenuations``, 1/mm, and ``phase_shares`` of the volume) and the group ``grains`` with one array a column.
If there are bodies beside the grains, the dataset ``bodies`` tells to which of them each voxel belongs (0 = none,
k = the k-th; attributes ``names``, ``kinds`` and ``freedoms``); files of older versions lack it.  The group ``field``
says what the reference scan saw (`io.field_hdf5`).  If a liquid surrounds the grains, the dataset ``fluid`` holds the
share of each voxel that it can fill (attributes ``attenuation``, 1/mm, and ``level``, mm, NaN if it reaches the top of
the field).

``motions.h5`` holds every field of `Motions` under its own name, in mm and **radians** as in Python (``motions.csv``
is in degrees), and the group ``fit`` with gain, offset, the convergence curve and the other fields of `StateFit`.
Each dataset has the attributes ``unit`` and ``meaning``, each file ``content``, ``version``, ``frame`` and ``settings``
(JSON); `io.contents` lists them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from grainmotion.io.contents import MOTION_DATASETS, REFERENCE_DATASETS, describe_hdf5
from grainmotion.io.field_hdf5 import read_field, write_field
from grainmotion.io.files import atomic_write
from grainmotion.io.fit_hdf5 import read_bodies, read_new_grains, read_pieces, write_parts
from grainmotion.io.hdf5 import opened
from grainmotion.io.hdf5_slabs import read_whole, write_whole
from grainmotion.model.detector_response import Response
from grainmotion.model.fluid import Fluid, FluidFit
from grainmotion.model.grains import GrainSet
from grainmotion.model.hardening import LINEAR, Hardening
from grainmotion.model.label_sums import label_sizes
from grainmotion.model.motion_table import MOTIONS_CONTENT
from grainmotion.model.motions import Motions
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.scene import Body, Freedom, Scene, first_voxel
from grainmotion.model.state_fit import StateFit
from grainmotion.model.summary import Summarised, Summary, shape_text
from grainmotion.model.thumbnails import grey_picture
from grainmotion.model.volume import Volume
from grainmotion.segmentation.phases import Phase

_ARRAYS = {
    "labels": "1",
    "centers": "mm",
    "translations": "mm",
    "rotations": "rad",
    "covariances": "of mm, mm, mm, rad, rad, rad",
    "residuals": "1",
    "iterations": "1",
}
"""Arrays of `Motions` and their units, "1" for numbers without one."""
REFERENCE_CONTENT = "reference state: volume, grains and what is beside them"
_OK_FLAGS = ("ok_translation", "ok_rotation")
"""Arrays of `Motions` that files of older versions lack: 1 where translation or rotation is a result to use."""
_STRAINS = ("strains", "strain_covariances")
"""Arrays of `Motions` that are there where strains were measured, numbers without a unit."""
_OPTIONAL = {
    "corrections": "pixel, pixel, rad",  # columns of StateFit.view_corrections
    "corrections_sd": "pixel, pixel, rad",
}
"""Arrays of `StateFit` that may be missing, and their units."""


@dataclass(frozen=True, eq=False, repr=False)
class StoredReference(Summarised):
    """The reference state: its volume (1/mm) and the labels of its grains."""

    volume: Volume
    residuals: tuple[float, ...] = ()  # relative, after each sweep; empty if the volume was given
    labels: NDArray[np.int32] | None = None  # (nz, ny, nx); None until the volume is segmented
    threshold: float = float("nan")  # attenuation above which a voxel is grain, 1/mm; NaN if the labels were given
    border: tuple[int, ...] = ()  # labels of the grains that touch the border of the field of view
    scene: Scene | None = None  # bodies beside the grains; None if the file does not tell
    phases: tuple[
        Phase, ...
    ] = ()  # air, liquid, grains, bodies, as segmentation found them; empty if labels were given

    def _summary(self) -> Summary:
        rows = [("volume", f"{shape_text(self.volume.shape)} voxels of {self.volume.voxel_size:.5g} mm")]
        rows += [
            ("labels", "none yet" if self.labels is None else f"{shape_text(self.labels.shape)} {self.labels.dtype}")
        ]
        rows += [("residual", f"{self.residuals[-1]:.3g} after {len(self.residuals)} sweeps")] if self.residuals else []
        middle = self.volume.array[self.volume.shape[0] // 2]
        return Summary("StoredReference", rows[0][1], tuple(rows), grey_picture(middle, upwards=True))


def write_reference(
    path: str | Path,
    reference: StoredReference,
    grains: GrainSet | None = None,
    settings: Mapping[str, object] | None = None,
) -> None:
    """Write a ``reference.h5``: the volume, its labels if it is segmented, and the table of ``grains`` if given."""
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        volume = write_whole(file, "volume", reference.volume.array)
        volume.attrs.update(voxel_size=reference.volume.voxel_size, center=reference.volume.center, unit="1/mm")
        file["residuals"] = np.asarray(reference.residuals, dtype=float)
        write_field(file, reference.volume.field)
        curve = reference.volume.hardening
        volume.attrs.update(hardening=curve.coefficients, hardening_longest=curve.longest, hardening_sd=curve.sd)
        if reference.labels is not None:
            labels = write_whole(file, "labels", reference.labels, compressed=True)
            labels.attrs["threshold"] = reference.threshold
            labels.attrs["border"] = np.asarray(reference.border, dtype=np.int64)
            kinds = [phase.kind for phase in reference.phases]
            labels.attrs.create("phase_kinds", kinds, dtype=h5py.string_dtype())
            labels.attrs["phase_attenuations"] = np.array(
                [phase.attenuation for phase in reference.phases], dtype=float
            )
            labels.attrs["phase_shares"] = np.array([phase.share for phase in reference.phases], dtype=float)
        if grains is not None and reference.labels is not None:
            table = file.create_group("grains")
            table.attrs["units"] = "mm, mm^3"
            for name, values in grain_columns(grains, reference.labels).items():
                table[name] = values
            _write_bodies(file, reference.volume, grains.scene)
            if grains.scene.fluid is not None:
                _write_fluid(file, grains.scene.fluid)
        describe_hdf5(file, REFERENCE_CONTENT, REFERENCE_DATASETS, settings)


def _write_bodies(file: h5py.File, volume: Volume, scene: Scene) -> None:
    """To which body each voxel belongs, and what the bodies are."""
    text = h5py.string_dtype()
    owners = np.zeros(volume.shape, np.min_scalar_type(len(scene.bodies)))
    for k, body in enumerate(scene.bodies, start=1):
        start = first_voxel(body.volume, volume)
        box = tuple(slice(a, a + n) for a, n in zip(start, body.volume.shape, strict=True))
        owners[box][body.volume.array != 0] = k
    data = write_whole(file, "bodies", owners, compressed=True)
    data.attrs.create("names", [body.name for body in scene.bodies], dtype=text)
    data.attrs.create("kinds", [body.kind for body in scene.bodies], dtype=text)
    data.attrs.create("freedoms", [body.freedom.text for body in scene.bodies], dtype=text)


def _write_fluid(file: h5py.File, fluid: Fluid) -> None:
    """The liquid: the space that it can fill, its attenuation and its level."""
    data = write_whole(file, "fluid", fluid.space.array, compressed=True)
    level = float("nan") if fluid.level is None else fluid.level
    data.attrs.update(attenuation=fluid.attenuation, level=level, units="1, 1/mm, mm")


def _read_scene(file: h5py.File, volume: Volume) -> Scene | None:
    """The scene as far as the file tells it."""
    if "bodies" not in file:
        return None
    data = file["bodies"]
    owners, bodies = read_whole(data), []
    for k, (name, kind, freedom) in enumerate(zip(*(data.attrs[a] for a in ("names", "kinds", "freedoms"))), start=1):
        bodies.append(Body(str(name), kind, volume.cropped(owners == k), Freedom.of(str(freedom))))
    fluid = None
    if "fluid" in file:
        level = float(file["fluid"].attrs["level"])
        space = replace(volume, array=read_whole(file["fluid"]))
        fluid = Fluid(float(file["fluid"].attrs["attenuation"]), space, None if np.isnan(level) else level)
    return Scene(tuple(bodies), fluid, volume.field, volume.hardening)


def read_reference(path: str | Path) -> StoredReference:
    """Read a ``reference.h5``, but for the table of grains, which follows from volume and labels."""
    with opened(path) as file:
        data = file["volume"]
        x, y, z = (float(c) for c in data.attrs["center"])
        volume = Volume(
            read_whole(data), float(data.attrs["voxel_size"]), (x, y, z), read_field(file), _read_hardening(data)
        )
        residuals = tuple(float(r) for r in file["residuals"][()])
        if "labels" not in file:
            return StoredReference(volume, residuals)
        labels = file["labels"]
        border = tuple(int(b) for b in labels.attrs["border"])
        return StoredReference(
            volume,
            residuals,
            read_whole(labels),
            float(labels.attrs["threshold"]),
            border,
            _read_scene(file, volume),
            _read_phases(labels),
        )


def _read_hardening(volume: h5py.Dataset) -> Hardening:
    """The curve that linearised the scan; the identity from a file without it."""
    if "hardening" not in volume.attrs:
        return LINEAR
    longest, sd = (float(volume.attrs[f"hardening_{name}"]) for name in ("longest", "sd"))
    return Hardening(tuple(float(c) for c in volume.attrs["hardening"]), longest, sd)


def _read_phases(labels: h5py.Dataset) -> tuple[Phase, ...]:
    """The phases as far as the file tells them."""
    if "phase_kinds" not in labels.attrs:
        return ()
    columns = (labels.attrs[f"phase_{name}"] for name in ("kinds", "attenuations", "shares"))
    return tuple(Phase(kind, float(value), float(share)) for kind, value, share in zip(*columns, strict=True))


def grain_columns(grains: GrainSet, labels: NDArray[np.int32]) -> dict[str, NDArray[np.generic]]:
    """The grains' table: label, centre of mass (mm), segmented volume (mm³), whether it touches the field's border."""
    centers = grains.centers
    voxels = label_sizes(labels, int(grains.labels.max(initial=0)) + 1)
    return {
        "label": grains.labels,
        "x": centers[:, 0],
        "y": centers[:, 1],
        "z": centers[:, 2],
        "volume": voxels[grains.labels] * grains.voxel_size**3,
        "touches_border": np.array([g.touches_border for g in grains.grains], dtype=bool),
    }


def write_motions_h5(path: str | Path, motions: Motions, settings: Mapping[str, object] | None = None) -> None:
    """Write the motions of one state, mm and radians, with covariances, reasons and the fit as a whole."""
    text = h5py.string_dtype()
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        for name, unit in _ARRAYS.items():
            file.create_dataset(name, data=getattr(motions, name)).attrs["unit"] = unit
        for name in _OK_FLAGS:
            file.create_dataset(name, data=getattr(motions, name).astype(np.uint8)).attrs["unit"] = "1"
        for name in _STRAINS if motions.strains is not None else ():
            file.create_dataset(name, data=getattr(motions, name)).attrs["unit"] = "1"
        file.create_dataset("statuses", data=[str(s) for s in motions.statuses], dtype=text)
        file.create_dataset("reasons", data=list(motions.reasons), dtype=text)
        fit = file.create_group("fit")
        fit.attrs.update(gain=motions.fit.gain, offset=motions.fit.offset)
        fit.create_dataset("stage", data=[stage for stage, _ in motions.fit.costs], dtype=text)
        fit["cost"] = np.array([cost for _, cost in motions.fit.costs], dtype=float)
        fit.attrs["downweighted"] = motions.fit.downweighted
        fit.attrs["start_residuals"] = np.array(motions.fit.start_residuals, dtype=float)
        fit.create_dataset("notes", data=list(motions.fit.notes), dtype=text)
        if motions.fit.fluid is not None:
            group = fit.create_group("fluid")
            group.attrs.update({**asdict(motions.fit.fluid), "units": "1/mm, mm"})
        views, views_sd = motions.fit.view_corrections, motions.fit.view_corrections_sd
        optional = (views and views.columns, views_sd and views_sd.columns)
        for (name, unit), value in zip(_OPTIONAL.items(), optional, strict=True):
            if value is not None:
                fit.create_dataset(name, data=value).attrs["unit"] = unit
        write_parts(fit, motions.fit)
        if motions.fit.response is not None:
            fit["polynomial"] = motions.fit.response.polynomial
            fit["background_terms"] = motions.fit.response.background
        describe_hdf5(file, MOTIONS_CONTENT, MOTION_DATASETS, settings)


def _read_fluid(fit: h5py.Group) -> FluidFit | None:
    if "fluid" not in fit:
        return None
    return FluidFit(**{name.name: float(fit["fluid"].attrs[name.name]) for name in fields(FluidFit)})


def read_motions_h5(path: str | Path) -> Motions:
    """Read a ``motions.h5`` of this version or an older one; fields that an older one did not write have defaults."""
    with opened(path) as file:
        fit = file["fit"]
        costs = zip(fit["stage"].asstr()[()], fit["cost"][()])
        views, views_sd = (fit[name][()] if name in fit else None for name in _OPTIONAL)
        polynomial = fit["polynomial"][()] if "polynomial" in fit else None
        return Motions(
            **{name: file[name][()] for name in _ARRAYS},
            **{name: file[name][()].astype(bool) for name in _OK_FLAGS if name in file},
            **{name: file[name][()] for name in _STRAINS if name in file},
            statuses=np.array(file["statuses"].asstr()[()], dtype="<U20"),
            reasons=tuple(str(r) for r in file["reasons"].asstr()[()]),
            fit=StateFit(
                gain=float(fit.attrs["gain"]),
                offset=float(fit.attrs["offset"]),
                costs=tuple((str(stage), float(cost)) for stage, cost in costs),
                response=None if polynomial is None else Response(polynomial, fit["background_terms"][()]),
                downweighted=float(fit.attrs.get("downweighted", 0.0)),
                notes=tuple(str(n) for n in fit["notes"].asstr()[()]) if "notes" in fit else (),
                view_corrections=None if views is None else ViewCorrections.of(views),
                view_corrections_sd=None if views_sd is None else ViewCorrections.of(views_sd),
                bodies=read_bodies(fit),
                fluid=_read_fluid(fit),
                appeared=read_new_grains(fit),
                pieces=read_pieces(fit),
                start_residuals=tuple(float(r) for r in fit.attrs.get("start_residuals", ())),
            ),
        )
