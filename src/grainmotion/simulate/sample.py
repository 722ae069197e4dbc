"""Sample: particles with exact shapes, the tube that contains them, and bodies such as pistons."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.summary import Summarised, Summary
from grainmotion.rotations import rotation_matrix, rotation_vector
from grainmotion.simulate.shapes import Ellipsoid, Mesh, Shape


@dataclass(frozen=True, eq=False, repr=False)
class Particle(Summarised):
    """One grain: a shape with its inclusions.

    Attributes
    ----------
    shape : Mesh or Ellipsoid
        Its outer surface.
    attenuation : float
        Attenuation of its bulk, 1/mm.
    inclusions : tuple of (Ellipsoid or Mesh, float)
        Shapes wholly inside it, none overlapping another, each with its attenuation in 1/mm.

    Examples
    --------
    >>> particle = case.sample.particles[0]
    >>> particle.attenuation, particle.center.shape
    (0.1, (3,))
    """

    shape: Shape
    attenuation: float
    inclusions: tuple[tuple[Shape, float], ...] = ()

    @property
    def parts(self) -> tuple[tuple[Shape, float], ...]:
        """Shapes with the attenuation that each *adds* (1/mm): the bulk, then the inclusions' differences."""
        differences = tuple((shape, value - self.attenuation) for shape, value in self.inclusions)
        return ((self.shape, self.attenuation), *differences)

    @property
    def mass(self) -> float:
        """Attenuation integrated over the volume, mm²."""
        return float(sum(value * shape.volume for shape, value in self.parts))

    @property
    def center(self) -> Float:
        """Attenuation-weighted centre of mass ``(3,)``, mm: the centre of its rotations."""
        moments = [value * shape.volume * shape.centroid for shape, value in self.parts]
        return np.sum(moments, axis=0) / self.mass

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Particle:
        """Apply x → matrix · x + shift.

        Parameters
        ----------
        matrix, shift : (3, 3) and (3,) array_like
            A rotation, for meshes any linear map that keeps the orientation, and a translation, mm.

        Returns
        -------
        Particle
            The transformed particle.
        """
        inclusions = tuple((shape.moved(matrix, shift), value) for shape, value in self.inclusions)
        return Particle(self.shape.moved(matrix, shift), self.attenuation, inclusions)


@dataclass(frozen=True)
class Tube:
    """A cylindrical wall: upright about the z axis, unless it was moved.

    Attributes
    ----------
    inner_radius, outer_radius : float
        mm.
    attenuation : float
        1/mm.
    bottom, top : float
        Heights of its two ends above ``center``, along its own axis, mm.
    center : (float, float, float)
        A point of its axis, mm.
    rotation : (float, float, float)
        Rotation vector that carries z to its axis, radians.

    Examples
    --------
    >>> gm.simulate.Tube(3.0, 3.2, 0.05).outer_radius
    3.2
    """

    inner_radius: float
    outer_radius: float
    attenuation: float
    bottom: float = -1e6
    top: float = 1e6
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 <= self.inner_radius < self.outer_radius:
            fact = f"inner radius {self.inner_radius} mm is not below outer radius {self.outer_radius} mm"
            raise InputError("tube", fact, "give 0 <= inner_radius < outer_radius")

    @property
    def axes(self) -> Float:
        """Unit vectors of its own x, y and z in columns ``(3, 3)``."""
        return rotation_matrix(self.rotation)

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Tube:
        """Apply x → matrix · x + shift.

        Parameters
        ----------
        matrix, shift : (3, 3) and (3,) array_like
            A rotation and a translation, mm.

        Returns
        -------
        Tube
            The transformed tube.
        """
        m = np.asarray(matrix, dtype=float)
        x, y, z = m @ self.center + np.asarray(shift, dtype=float)
        a, b, c = rotation_vector(m @ self.axes)
        return replace(self, center=(float(x), float(y), float(z)), rotation=(float(a), float(b), float(c)))


@dataclass(frozen=True, eq=False, repr=False)
class Sample(Summarised):
    """Particles, labelled 1 to n in order, their container, and what else attenuates.

    Attenuations add up where shapes overlap: in a tube or body that stands for a liquid, a particle has the excess of
    its attenuation over the liquid's.

    Attributes
    ----------
    particles : tuple of Particle
        The grains.
    tube : Tube, optional
        A wall, or a column of liquid.
    bodies : tuple of Particle
        What attenuates and is no grain, such as pistons; without labels.

    Examples
    --------
    >>> len(case.sample.particles), case.sample.centers.shape
    (4, (4, 3))
    """

    particles: tuple[Particle, ...]
    tube: Tube | None = None
    bodies: tuple[Particle, ...] = ()

    def __len__(self) -> int:
        return len(self.particles)

    @property
    def labels(self) -> NDArray[np.int64]:
        """1 to n, ``(n,)``."""
        return np.arange(1, len(self) + 1)

    @property
    def centers(self) -> Float:
        """Attenuation-weighted centres of mass ``(n, 3)``, mm."""
        return np.array([p.center for p in self.particles]).reshape(-1, 3)

    def moved(self, motions: Motions) -> Sample:
        """Move each particle to x = Ω (X − c) + u + c; tube and bodies stay (see `Tube.moved`, `Particle.moved`).

        Parameters
        ----------
        motions : Motions
            One a particle, in the order of the labels.

        Returns
        -------
        Sample
            The sample in its later state.

        Raises
        ------
        InputError
            If the labels of the motions are not 1 to n.
        """
        if not np.array_equal(motions.labels, self.labels):
            raise InputError("motions", f"{len(motions)} motions for {len(self)} particles", "give labels 1 to n")
        rows = zip(self.particles, motions.matrices, motions.translations, motions.centers, strict=True)
        particles = tuple(p.moved(matrix, u + c - matrix @ c) for p, matrix, u, c in rows)
        return replace(self, particles=particles)

    def _summary(self) -> Summary:
        rows = [("particles", str(len(self.particles)))]
        rows += [("tube", "around them")] if self.tube is not None else []
        rows += [("bodies", str(len(self.bodies)))] if self.bodies else []
        return Summary("Sample", f"{len(self.particles)} particles", tuple(rows))


@checked_arguments
def ellipsoid_particle(
    rng: np.random.Generator,
    diameter: float,
    attenuation: float,
    *,
    inclusion_attenuation: float | None = None,
    elongation: float = 1.3,
) -> Particle:
    """A random ellipsoid at the origin, optionally with a smaller off-centre ellipsoid inside.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the shapes.
    diameter : float
        Diameter of the sphere of the same volume, mm.
    attenuation : float
        1/mm.
    inclusion_attenuation : float, optional
        1/mm; no inclusion if None.
    elongation : float
        Largest ratio between two semi-axes.

    Returns
    -------
    Particle
        The ellipsoid, its semi-axes along x, y and z.

    Examples
    --------
    >>> gm.simulate.ellipsoid_particle(np.random.default_rng(0), 1.0, 0.1).attenuation
    0.1
    """
    ratios = np.exp(rng.uniform(-0.5, 0.5, 3) * np.log(elongation))
    semi_axes = diameter / 2 * ratios / np.cbrt(np.prod(ratios))
    body = Ellipsoid(np.zeros(3), semi_axes, np.eye(3))
    if inclusion_attenuation is None:
        return Particle(body, attenuation)
    # an ellipsoid of 0.45 times the size, shifted by at most 0.4 of the radius: inside at any rotation
    axes = _random_rotation(rng)
    offset = rng.normal(size=3)
    offset *= 0.4 * rng.uniform() ** (1 / 3) / np.linalg.norm(offset)
    small = 0.45 * semi_axes.min() * rng.uniform(0.6, 1.0, 3)
    inclusion = Ellipsoid(offset * semi_axes, small, axes)
    return Particle(body, attenuation, ((inclusion, inclusion_attenuation),))


@checked_arguments
def inscribed(mesh: Mesh, rng: np.random.Generator) -> Ellipsoid:
    """A random, off-centre ellipsoid inside a mesh, about half as wide as the largest ball that fits.

    Parameters
    ----------
    mesh : Mesh
        The shape around it.
    rng : numpy.random.Generator
        Source of its size, position and rotation.

    Returns
    -------
    Ellipsoid
        Wholly inside the mesh.

    Examples
    --------
    >>> core = gm.simulate.inscribed(case.sample.particles[0].shape, np.random.default_rng(0))
    >>> core.semi_axes.shape
    (3,)
    """
    clearance = mesh.clearance
    axes = _random_rotation(rng)
    direction = rng.normal(size=3)
    offset = clearance * rng.uniform(0.2, 0.35) * direction / np.linalg.norm(direction)
    return Ellipsoid(mesh.star_point + offset, clearance * rng.uniform(0.45, 0.64, 3), axes)


def _random_rotation(rng: np.random.Generator) -> Float:
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return matrix * np.sign(np.linalg.det(matrix))
