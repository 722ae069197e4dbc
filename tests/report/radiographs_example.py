"""Reports of a few balls and bars whose radiographs are sums of their projected voxels."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from grainmotion._typing import Beam, Float
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData, StateReport
from grainmotion.rotations import rotation_matrix

VOXEL = 0.1  # mm
PANEL = (56, 70)
TILTED = DetectorAlignment(detector_offset=(0.3, -0.2), detector_tilts_deg=(1.0, 2.0, -3.0))
LABELS = (3, 5, 9)


def geometry(beam: Beam, first_row: Literal["bottom", "top"]) -> Geometry:
    """Two views of a tilted panel; with row 0 at the top, v points down."""
    angles = [0.0, 65.0]
    if beam == "parallel":
        views = Geometry.parallel(angles, PANEL, 0.1, panel=TILTED)
    else:
        views = Geometry.cone(angles, PANEL, 0.2, source_to_axis=20.0, source_to_detector=40.0, panel=TILTED)
    if first_row == "bottom":
        return views
    vectors = views.vectors.copy()
    vectors[:, 9:] *= -1
    return Geometry(vectors, PANEL, beam)


def labels() -> np.ndarray:
    """A ball, a bar and a flat ball, apart from each other."""
    z, y, x = np.indices((40, 44, 48))
    array = np.zeros(z.shape, np.int32)
    array[(x - 12) ** 2 + (y - 20) ** 2 + (z - 12) ** 2 < 49] = LABELS[0]
    array[(abs(x - 34) < 9) & (abs(y - 14) < 4) & (abs(z - 26) < 5)] = LABELS[1]
    array[(x - 26) ** 2 / 4 + (y - 34) ** 2 + (z - 14) ** 2 < 16] = LABELS[2]
    return array


def voxels(label: int, motions: Motions | None = None) -> Float:
    """Places of the voxels of a grain, mm, moved if motions are given."""
    array = labels()
    volume = Volume(array.astype(np.float32), VOXEL, (0.2, -0.1, 0.3))
    places = volume.origin + VOXEL * np.argwhere(array == label)[:, ::-1]
    if motions is None:
        return places
    k = list(motions.labels).index(label)
    turned = (places - motions.centers[k]) @ rotation_matrix(motions.rotations[k]).T
    return turned + motions.centers[k] + motions.translations[k]


def moved() -> Motions:
    """Motions of the three grains; the last one has none."""
    centers = np.stack([voxels(label).mean(axis=0) for label in LABELS])
    motions = Motions.identity(np.array(LABELS), centers)
    translations = np.array([[0.2, -0.1, 0.15], [-0.3, 0.2, -0.1], [np.nan] * 3])
    rotations = np.array([[0.3, 0.1, -0.2], [0.5, -0.6, 0.9], [np.nan] * 3])
    statuses = np.array(["converged", "converged", "absent"])
    return replace(motions, translations=translations, rotations=rotations, statuses=statuses)


def report(beam: Beam = "cone", first_row: Literal["bottom", "top"] = "bottom") -> ReportData:
    """Two states: the grains in place, and moved; a column of the second state's first view is masked."""
    views, array = geometry(beam, first_row), labels()
    states = []
    for k, motions in enumerate((replace(moved(), translations=np.zeros((3, 3)), rotations=np.zeros((3, 3))), moved())):
        images = np.zeros((len(views), *PANEL))
        for label in LABELS[: 3 - k]:
            places = views.project_points(voxels(label, motions))
            for image, pixels in zip(images, np.rint(places).astype(int), strict=True):
                inside = ((pixels >= 0) & (pixels < PANEL)).all(axis=1)
                np.add.at(image, tuple(pixels[inside].T), 0.1)
        measured = images + np.random.default_rng(k).normal(0, 0.02, images.shape)
        if k:
            measured[0, :, 66] = np.nan
        states.append(
            StateReport(f"load-{k}", measured, images, motions, VOXEL, first_row=first_row, geometry=views)
        )  # fmt: skip
    volume = Volume((array > 0) * np.float32(0.5), VOXEL, (0.2, -0.1, 0.3))
    return ReportData(title="three grains", volume=volume, labels=array, states=tuple(states))
