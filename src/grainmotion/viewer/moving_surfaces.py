"""The grains' surfaces at their places in every state, as one mesh with the axis of the states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Float
from grainmotion.analysis.deformed_volume import WITHOUT_MOTION
from grainmotion.analysis.grain_mesh import GrainMesh
from grainmotion.io.results_folder import ResultsFolder
from grainmotion.model.motions import Motions
from grainmotion.rotations import apply_motion
from grainmotion.viewer.grain_values import (
    ROTATION_VALUES,
    STATUS,
    TRANSLATION_VALUES,
    UNUSED_RGBA,
    colour_range,
    grain_colours,
    grain_table,
)
from grainmotion.workflow.exports import display_meshes


@dataclass(frozen=True, eq=False)
class PlacedGrain:
    """A grain in one state: 0 is the reference."""

    step: int
    vertices: NDArray[np.floating]  # (n, 3), mm, x y z
    faces: NDArray[np.integer]
    value: float  # NaN if it has none there
    colour: Float  # (4,), by status


def surface_layers(stored: ResultsFolder, value: str) -> list[tuple[object, dict[str, object]]]:
    """Data and keywords of the surfaces: by status one layer; by a number those with a value, then those without."""
    meshes = dict(display_meshes(stored.grains))
    placed = list(_placed_grains(meshes, stored, value))
    if value == STATUS:
        return [_layer("surfaces", placed, value)] if placed else []
    known = [grain for grain in placed if np.isfinite(grain.value)]
    unknown = [grain for grain in placed if not np.isfinite(grain.value)]
    groups = {"surfaces": known, "surfaces without a value": unknown}
    return [_layer(name, group, value) for name, group in groups.items() if group]


def _placed_grains(meshes: dict[int, GrainMesh], stored: ResultsFolder, value: str) -> Iterator[PlacedGrain]:
    """Every grain in the reference, and in every state where its place is known."""
    still = 0.0 if value in (*TRANSLATION_VALUES, *ROTATION_VALUES) and stored.motions else np.nan
    for mesh in meshes.values():
        yield PlacedGrain(0, mesh.vertices, mesh.faces, still, np.array(UNUSED_RGBA))
    for step, motions in enumerate(stored.motions.values(), start=1):
        colours = grain_colours(motions, value)
        values = np.full(len(motions), np.nan) if value == STATUS else grain_table(motions)[value].to_numpy(float)
        for row in np.flatnonzero(_has_place(motions)):
            label = int(motions.labels[row])
            if label in meshes:
                mesh = meshes[label]
                place = motions.translations[row], motions.centers[row]
                vertices = apply_motion(motions.gradients[row], *place, mesh.vertices)
                yield PlacedGrain(step, vertices, mesh.faces, float(values[row]), colours[row])


def _has_place(motions: Motions) -> NDArray[np.bool_]:
    """Grains that are drawn in a state, as in the rebuilt volume and in ParaView's files."""
    finite = np.isfinite(motions.translations).all(axis=1) & np.isfinite(motions.rotations).all(axis=1)
    return finite & ~np.isin(motions.statuses, WITHOUT_MOTION)


def _layer(name: str, grains: list[PlacedGrain], value: str) -> tuple[object, dict[str, object]]:
    """One mesh of many grains in many states."""
    counts = np.array([len(grain.vertices) for grain in grains])
    steps = np.repeat([float(grain.step) for grain in grains], counts)
    vertices = np.column_stack([steps, np.concatenate([grain.vertices[:, ::-1] for grain in grains])])
    starts = np.cumsum(counts) - counts
    faces = np.concatenate([grain.faces + start for grain, start in zip(grains, starts, strict=True)])
    keywords: dict[str, object] = {"name": name, "shading": "smooth"}
    vertices = vertices.astype(np.float32)
    if value == STATUS or not np.isfinite(grains[0].value):
        colours = [UNUSED_RGBA if value != STATUS else grain.colour for grain in grains]
        return (vertices, faces), keywords | {"vertex_colors": np.repeat(np.array(colours), counts, axis=0)}
    values = np.array([grain.value for grain in grains])
    colours_by, limits = colour_range(values)
    keywords |= {"colormap": colours_by, "contrast_limits": limits}
    return (vertices, faces, np.repeat(values, counts).astype(np.float32)), keywords
