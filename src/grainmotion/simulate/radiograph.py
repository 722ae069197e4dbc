"""Radiographs of exact samples: exact path lengths, averaged over each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.kernels import mesh_projection
from grainmotion.model.geometry import Geometry
from grainmotion.model.progress import counted
from grainmotion.simulate.sample import Sample, Tube
from grainmotion.simulate.shapes import Ellipsoid, Mesh

Averaging = Literal["intensity", "line-integral"]
VIEWS_OF_A_CALL = 16
"""Views that one call of the kernel makes, which shares them between cores; signals are looked at after each."""


@checked_arguments
def line_integrals(
    sample: Sample,
    geometry: Geometry,
    *,
    subsamples: int = 3,
    averaging: Averaging = "intensity",
    spectrum: Sequence[tuple[float, float]] = ((1.0, 1.0),),
) -> NDArray[np.float32]:
    """Noise-free line integrals −ln(transmission) of a sample.

    Parameters
    ----------
    sample : Sample
        Particles, tube and bodies, mm, 1/mm.
    geometry : Geometry
        The views.
    subsamples : int
        Rays along each side of a pixel, so that a pixel averages ``subsamples`` squared rays.
    averaging : {"intensity", "line-integral"}
        What a pixel averages over its area.  A detector averages intensities.
    spectrum : sequence of (weight, ratio)
        Energies of the beam: its share of the detected photons, and the ratio of every attenuation
        at that energy to the one given in the sample.  One energy by default.

    Returns
    -------
    (views, rows, columns) float32 array
        Dimensionless.

    Raises
    ------
    InputError
        If a particle reaches behind the source, or a number is out of its range.

    Examples
    --------
    >>> images = gm.simulate.line_integrals(case.sample, case.scanner.geometry((0, 90)))
    >>> images.shape
    (2, 96, 72)
    """
    fraction = transmission(sample, geometry, subsamples=subsamples, averaging=averaging, spectrum=spectrum)
    return (-np.log(fraction)).astype(np.float32)


@checked_arguments
def transmission(
    sample: Sample,
    geometry: Geometry,
    *,
    subsamples: int = 3,
    averaging: Averaging = "intensity",
    spectrum: Sequence[tuple[float, float]] = ((1.0, 1.0),),
) -> Float:
    """Fraction of the beam that reaches each pixel, without noise.

    Parameters
    ----------
    sample, geometry : Sample, Geometry
        The sample and the views.
    subsamples, averaging, spectrum : int, str, sequence of (float, float)
        As in `line_integrals`.

    Returns
    -------
    (views, rows, columns) float64 array
        0 to 1.

    Raises
    ------
    InputError
        If a particle reaches behind the source, or a number is out of its range.

    Examples
    --------
    >>> fraction = gm.simulate.transmission(case.sample, case.scanner.geometry((0,)))
    >>> bool(0 < fraction.min() < fraction.max() <= 1)
    True
    """
    if subsamples < 1:
        raise InputError("subsamples", f"must be >= 1, got {subsamples}", "3 is accurate to the photon noise")
    energies = np.asarray(spectrum, dtype=float).reshape(-1, 2)
    if len(energies) == 0 or (energies < 0).any() or energies[:, 0].sum() <= 0:
        raise InputError("spectrum", f"{spectrum} is no list of weights and ratios", "give (weight, ratio) >= 0")
    cone = geometry.beam == "cone"
    views = geometry.vectors.copy()
    if not cone:
        views[:, :3] /= np.linalg.norm(geometry.source, axis=1, keepdims=True)
    inverses, origins, signs = _frames(Geometry(views, geometry.shape, geometry.beam))
    vertices, faces, face_weights = _triangles(sample)
    _check_in_front(vertices, inverses, origins, cone)
    ellipsoids = [(s, w) for p in (*sample.particles, *sample.bodies) for s, w in p.parts if isinstance(s, Ellipsoid)]
    boxes = np.array([_boxes(s, geometry, subsamples) for s, _ in ellipsoids], dtype=np.int64)
    tube = sample.tube
    out = np.empty((len(views), *geometry.shape))
    boxes = np.ascontiguousarray(boxes.reshape(len(ellipsoids), len(views), 4).transpose(1, 0, 2))
    for first in counted(range(0, len(views), VIEWS_OF_A_CALL)):
        part = slice(first, first + VIEWS_OF_A_CALL)
        mesh_projection.transmission(
            views[part],
            cone,
            vertices,
            faces,
            face_weights,
            np.array([s.center for s, _ in ellipsoids]).reshape(-1, 3),
            np.array([s.whitening for s, _ in ellipsoids]).reshape(-1, 3, 3),
            np.array([w for _, w in ellipsoids], dtype=float),
            boxes[part],
            inverses[part],
            origins[part],
            signs[part],
            _tube_numbers(tube),
            tube.attenuation if tube else 0.0,
            subsamples,
            averaging == "intensity",
            energies[:, 0] / energies[:, 0].sum(),
            np.ascontiguousarray(energies[:, 1]),
            out[part],
        )
    return out


def _frames(geometry: Geometry) -> tuple[Float, Float, Float]:
    """Matrices, origins and handedness of each view's coordinates q (see `kernels.mesh_projection`)."""
    (rows, columns), s, u, v = geometry.shape, geometry.source, geometry.u, geometry.v
    corner = geometry.detector - (columns - 1) / 2 * u - (rows - 1) / 2 * v
    cone = geometry.beam == "cone"
    frames = np.stack([u, v, corner - s if cone else s], axis=-1)
    signs = np.sign(np.linalg.det(frames)).astype(float)
    return np.linalg.inv(frames).astype(float), (s if cone else corner).copy(), signs


def _triangles(sample: Sample) -> tuple[Float, NDArray[np.int64], Float]:
    """All meshes of a sample as one: vertices, triangles and the attenuation that each bounds."""
    vertices, faces, weights, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [np.zeros(0)], 0
    for particle in (*sample.particles, *sample.bodies):
        for shape, weight in particle.parts:
            if isinstance(shape, Mesh):
                vertices.append(shape.vertices)
                faces.append(shape.faces + count)
                weights.append(np.full(len(shape.faces), weight))
                count += len(shape.vertices)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(weights)


def _tube_numbers(tube: Tube | None) -> Float:
    """The 16 numbers of a tube for the kernel, zeros without one."""
    if tube is None:
        return np.zeros(16)
    sizes = [tube.inner_radius, tube.outer_radius, tube.bottom, tube.top]
    return np.concatenate([sizes, tube.center, tube.axes.T.ravel()])


def _check_in_front(vertices: Float, inverses: Float, origins: Float, cone: bool) -> None:
    if not cone or len(vertices) == 0:
        return
    for view, (inverse, origin) in enumerate(zip(inverses, origins, strict=True)):
        if ((vertices - origin) @ inverse[2]).min() <= 0:
            raise InputError(f"view {view}", "a particle reaches behind the source", "move the source away")


def _boxes(shape: Ellipsoid, geometry: Geometry, subsamples: int) -> NDArray[np.int64]:
    """Bounds of an ellipsoid's footprint in samples: first and last row, first and last column ``(views, 4)``."""
    pixels = geometry.project_points(shape.outline)
    if np.isnan(pixels).any():
        raise InputError("ellipsoid", "it reaches behind the source", "move the source away")
    samples = (pixels + 0.5) * subsamples - 0.5
    limit = np.array(geometry.shape) * subsamples - 1
    low = np.clip(np.floor(samples.min(axis=1)), 0, limit + 1)
    high = np.clip(np.ceil(samples.max(axis=1)), -1, limit)
    return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1).astype(np.int64)
