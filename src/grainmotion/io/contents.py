"""What the HDF5 and JSON files of a run hold: unit and meaning of each dataset, attribute and key.

Datasets and attributes are named as ``fit/bodies/center`` and ``labels.threshold``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

import h5py

from grainmotion import __version__
from grainmotion.model.described_table import SAMPLE_FRAME, Columns, frozen

ALL_HDF5 = frozen(
    {
        ".content": ("text", "what the file holds"),
        ".version": ("text", "of grainmotion that wrote it"),
        ".frame": ("text", "axes and signs"),
        ".settings": ("text", "settings of the stage that made it, as JSON"),
    }
)
"""Attributes of every HDF5 file itself."""
_VOLUME = {
    "volume": ("1/mm", "attenuation [z, y, x] at the centres of the voxels"),
    "volume.voxel_size": ("mm", "edge of a voxel"),
    "volume.center": ("mm", "centre x y z of the array"),
    "volume.hardening": ("1", "coefficients of the curve by which the scan was linearised"),
    "volume.hardening_longest": ("1", "largest line integral for which it was found"),
    "volume.hardening_sd": ("1", "its standard deviation there"),
    "residuals": ("1", "relative residual of the reconstruction after each sweep; empty if the volume was given"),
    "field.radius": ("mm", "of the upright cylinder that holds the sample"),
    "field.axis": ("mm", "x y of the cylinder"),
    "field.above": ("yes or no", "whether the sample goes on above the field"),
    "field.below": ("yes or no", "whether it goes on below"),
    "field.beside": ("yes or no", "whether it goes on beside"),
    "field/vectors": ("mm", "views of the full scan, 12 numbers each, see docs/conventions.md"),
    "field/vectors.shape": ("1", "rows and columns of the panel"),
    "field/vectors.beam": ("text", "cone or parallel"),
    "field/shifts/values": ("pixel", "how far views are from where the others predict them"),
    "field/shifts/turns": ("rad", "the same as turns of the sample"),
    "field/shifts/views": ("1", "numbers of these views"),
    "field/shifts/times": ("1", "share of the scan at which each was taken"),
    "field/shifts/along": ("1", "direction along which the sample moved"),
    "field/shifts.pixel": ("mm", "edge of a pixel at the axis"),
    "field/shifts.half_width": ("pixel", "of the sample's shadow"),
}
REFERENCE_DATASETS: Columns = frozen({
    **_VOLUME,
    "labels": ("1", "label of the grain that holds each voxel, 0 for none"),
    "labels.threshold": ("1/mm", "attenuation above which a voxel is grain; NaN if labels were given"),
    "labels.border": ("1", "labels of grains that the border of the field cuts"),
    "labels.phase_kinds": ("text", "air, liquid, grains, body: kind of each phase"),
    "labels.phase_attenuations": ("1/mm", "attenuation of each phase"),
    "labels.phase_shares": ("1", "share of the voxels of each phase"),
    "grains/label": ("1", "label of each grain"),
    **{f"grains/{axis}": ("mm", f"centre of mass by attenuation, {axis}") for axis in "xyz"},
    "grains/volume": ("mm^3", "of the voxels with its label"),
    "grains/touches_border": ("yes or no", "whether it reaches the border of the field"),
    "bodies": ("1", "body that holds each voxel: 0 for none, k for the k-th"),
    "bodies.names": ("text", "name of each body"),
    "bodies.kinds": ("text", "piston, wall, rest or body"),
    "bodies.freedoms": ("text", "ways in which each may move"),
    "fluid": ("1", "share of each voxel that the liquid and the grains in it fill, at any level"),
    "fluid.attenuation": ("1/mm", "of the liquid"),
    "fluid.level": ("mm", "z of its surface; NaN if it reaches the top of the field"),
})  # fmt: skip
_COVARIANCE = ("of mm, mm, mm, rad, rad, rad", "covariance of (u, increment of the rotation on the left)")
_BODY = {
    "center": ("mm", "centre of mass in the reference"),
    "translation": ("mm", "u of the centre"),
    "rotation": ("rad", "rotation vector about the centre"),
    "covariance": _COVARIANCE,
}
MOTION_DATASETS: Columns = frozen({
    "labels": ("1", "label of each grain in the reference volume"),
    "centers": ("mm", "centre of mass by attenuation in the reference, x y z"),
    "translations": ("mm", "u of the centre, x y z"),
    "rotations": ("rad", "rotation vector about the centre, x y z (degrees in motions.csv)"),
    "covariances": _COVARIANCE,
    "statuses": ("text", "outcome of the fit, see docs/conventions.md"),
    "reasons": ("text", "cause and remedy where the grain did not converge"),
    "residuals": ("1", "root mean square of measured - simulated line integrals over the footprint"),
    "iterations": ("1", "of the fit"),
    "ok_translation": ("1", "1 where the translation is a result to use"),
    "ok_rotation": ("1", "1 where the rotation is a result to use"),
    "strains": ("1", "Biot strain e = U - I: xx yy zz yz xz xy, frame of the reference"),
    "strain_covariances": ("1", "covariance of the six strains"),
    "fit.gain": ("1", "a of measured = a simulated + b, mean over the views"),
    "fit.offset": ("1", "b of measured = a simulated + b, mean over the views"),
    "fit.downweighted": ("1", "share of the pixels to which a robust loss gave less weight"),
    "fit/stage": ("text", "stage of each iteration"),
    "fit/cost": ("1", "relative residual after each iteration, under the filter of its stage"),
    "fit/notes": ("text", "sentences on the state as a whole"),
    "fit/corrections": ("pixel, pixel, rad", "shift along u, along v, and turn of each view"),
    "fit/corrections_sd": ("pixel, pixel, rad", "their standard deviations"),
    "fit/polynomial": ("1", "response of the detector: powers of the line integral, by view"),
    "fit/background_terms": ("1", "background of each view"),
    "fit.start_residuals": ("1", "relative residual at the last state's motions and at their extrapolation"),
    "fit/fluid.attenuation": ("1/mm", "of the liquid"),
    "fit/fluid.attenuation_sd": ("1/mm", "its standard deviation"),
    "fit/fluid.level": ("mm", "z of the surface of the liquid"),
    "fit/fluid.level_sd": ("mm", "its standard deviation"),
    "fit/fluid.displaced": ("1", "share of the grains' volume that displaces liquid"),
    "fit/fluid.displaced_sd": ("1", "its standard deviation"),
    "fit/bodies/name": ("text", "name of each body"),
    "fit/bodies/kind": ("text", "piston, wall, rest or body"),
    "fit/bodies/freedom": ("text", "ways in which it may move"),
    "fit/bodies/moved": ("yes or no", "whether it moved"),
    **{f"fit/bodies/{name}": column for name, column in _BODY.items()},
    "fit/appeared/center": ("mm", "centre in this state of each grain that appeared"),
    "fit/appeared/center_sd": ("mm", "its standard deviations"),
    "fit/appeared/radius": ("mm", "of the ball of the same volume"),
    "fit/appeared/radius_sd": ("mm", "its standard deviation"),
    "fit/appeared/attenuation": ("1/mm", "of the ellipsoid"),
    "fit/pieces/label": ("1", "label of the grain that broke"),
    "fit/pieces/piece": ("1", "1 for the largest piece"),
    "fit/pieces/share": ("1", "share of the grain's attenuation"),
    "fit/pieces/status": ("text", "outcome of its fit"),
    **{f"fit/pieces/{name}": column for name, column in _BODY.items()},
})  # fmt: skip


def describe_hdf5(
    file: h5py.File, content: str, datasets: Columns, settings: Mapping[str, object] | None = None
) -> None:
    """Give a file its content, version, frame and settings, and each dataset its ``unit`` and ``meaning``."""
    file.attrs.update(content=content, version=__version__, frame=SAMPLE_FRAME)
    file.attrs["settings"] = settings_text(settings)

    def describe(path: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset) and path in datasets:
            unit, meaning = datasets[path]
            item.attrs.update(unit=unit, meaning=meaning)

    file.visititems(describe)


def settings_text(settings: Mapping[str, object] | None) -> str:
    """Settings as JSON; an empty object if they are not known."""
    return json.dumps(dict(settings or {}), default=str)


def about() -> dict[str, str]:
    """First keys of a JSON file: version and frame."""
    return {"grainmotion": __version__, "frame": SAMPLE_FRAME}
