"""Usual mistakes in a geometry, each as a change of the nominal geometry that would undo it.

All of them leave the radiographs as they are.  Radiographs in another order are views in another order, a flipped
image is a flipped step of the panel, and a wrong sense of rotation is another azimuth of each view.  So one record of a
name and a function from geometry to geometry describes every hypothesis, can be tested on the data, and can be applied
by the key ``fixes`` of the experiment file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix

Change = Callable[[Geometry], Geometry]
MAX_SPAN_IN_RADIANS = 4 * np.pi + 0.1
"""Angles that span more than two turns if they were radians are not taken for radians, degrees."""

EQUAL_STEPS = "equal-steps"
MAX_UNEQUAL = 0.05
"""Largest difference of a step between views from their mean, over it, of steps that are equal."""
OR_WRITE = "; or write "
"""Between what to change and the key ``fixes`` in the remedy of a finding."""


@dataclass(frozen=True)
class Hypothesis:
    """A usual mistake in a geometry.

    Attributes
    ----------
    name : str
        As in the key ``fixes``.
    mistake : str
        What would be wrong, to follow "probably", as in "the angles have the wrong sign".
    remedy : str
        What to change in the experiment file.
    change : callable
        From the nominal geometry to the one without the mistake.
    """

    name: str
    mistake: str
    remedy: str
    change: Change


def turned(geometry: Geometry, angles_deg: Float | float) -> Geometry:
    """Each view rotated about z, source and panel together; ``angles_deg`` holds one angle, or one a view."""
    angles = np.broadcast_to(np.deg2rad(angles_deg), len(geometry))
    matrices = rotation_matrix(angles[:, None] * np.array([0.0, 0.0, 1.0]))
    blocks = geometry.vectors.reshape(-1, 4, 3)
    return Geometry(np.einsum("vij,vbj->vbi", matrices, blocks).reshape(-1, 12), geometry.shape, geometry.beam)


def stage_angles_deg(geometry: Geometry) -> Float:
    """Angle of the stage in each view, degrees, continuous from view to view: the azimuth of u.

    Offsets of panel and axis do not change it.  The first angle lies in (-180, 180].
    """
    u = geometry.u
    return np.rad2deg(np.unwrap(np.arctan2(u[:, 1], u[:, 0])))


def seen_from_behind(geometry: Geometry) -> bool:
    """Whether columns run to the left as the source sees the panel, as some scanners write their images."""
    right = np.cross(geometry.rays[0], [0.0, 0.0, 1.0])
    return float(geometry.u[0] @ right) < 0


def _scaled_angles(factor: Callable[[int], float]) -> Change:
    """Steps between views multiplied by a factor that may depend on the number of views."""

    def change(geometry: Geometry) -> Geometry:
        angles = stage_angles_deg(geometry)
        return turned(geometry, (factor(len(geometry)) - 1) * (angles - angles[0]))

    return change


def _negated(geometry: Geometry) -> Geometry:
    return turned(geometry, -2 * stage_angles_deg(geometry))


def _from_radians(geometry: Geometry) -> Geometry:
    """Numbers that were given as degrees are radians."""
    angles = stage_angles_deg(geometry)
    if np.ptp(angles) > MAX_SPAN_IN_RADIANS:
        return geometry
    return turned(geometry, np.rad2deg(angles) - angles)


def _equal_steps(geometry: Geometry) -> Geometry:
    """Angles that are not equally spaced, made so between the first and the last."""
    angles = stage_angles_deg(geometry)
    return (
        geometry
        if has_equal_steps(geometry)
        else turned(geometry, np.linspace(angles[0], angles[-1], len(angles)) - angles)
    )


def has_equal_steps(geometry: Geometry) -> bool:
    """Whether the angles are equally spaced."""
    steps = np.diff(stage_angles_deg(geometry))
    return len(steps) < 2 or bool(np.abs(steps - steps.mean()).max() <= MAX_UNEQUAL * max(abs(steps.mean()), 1e-12))


def _with_steps(u_from: float, v_from: float, swapped: bool = False) -> Change:
    """Steps of the panel with other signs, or exchanged."""

    def change(geometry: Geometry) -> Geometry:
        u, v = (geometry.v, geometry.u) if swapped else (geometry.u, geometry.v)
        vectors = np.concatenate([geometry.source, geometry.detector, u_from * u, v_from * v], axis=1)
        return Geometry(vectors, geometry.shape, geometry.beam)

    return change


def _reversed(geometry: Geometry) -> Geometry:
    return geometry[::-1]


def _sorted_as_text(geometry: Geometry) -> Geometry:
    """Radiographs 0, 1, 10, 11, 2, ... instead of 0, 1, 2, ..."""
    order = sorted(range(len(geometry)), key=str)
    return geometry[order]


def _shifted_start(angle_deg: float) -> Change:
    return lambda geometry: turned(geometry, angle_deg)


_IN_ORDER = "give the radiographs in the order of the angles"
_ANGLES_KEY = "correct angles_deg"

HYPOTHESES: Mapping[str, Hypothesis] = MappingProxyType({
    h.name: h
    for h in (
        Hypothesis("angles-negated", "the stage turns the other way: the angles have the wrong sign",
                   "give the angles with the other sign", _negated),
        Hypothesis("angles-in-radians", "the angles are in radians", "give the angles in degrees", _from_radians),
        Hypothesis("end-point-counted", "the last angle is that of the first view a turn later, and is counted twice",
                   "leave out the last angle: last = first + span (count - 1)/count",
                   _scaled_angles(lambda n: (n - 1) / n)),
        Hypothesis("end-point-left-out", "the last angle belongs to the scan, but the angles stop one step before it",
                   "give the last angle that was taken", _scaled_angles(lambda n: n / max(n - 1, 1))),
        Hypothesis("half-the-span", "the views cover half of the given span, such as 180 instead of 360 degrees",
                   _ANGLES_KEY, _scaled_angles(lambda n: 0.5)),
        Hypothesis("twice-the-span", "the views cover twice the given span, such as 360 instead of 180 degrees",
                   _ANGLES_KEY, _scaled_angles(lambda n: 2.0)),
        Hypothesis(EQUAL_STEPS, "the views are equally spaced, and the given angles are not (those of another scan?)",
                   "give the angles of this scan", _equal_steps),
        Hypothesis("rows-flipped", "the rows of the radiographs run the other way", 'change first_row ("top" or '
                   '"bottom")', _with_steps(1, -1)),
        Hypothesis("columns-flipped", "the columns of the radiographs run the other way (images flipped left to right)",
                   "flip the images", _with_steps(-1, 1)),
        Hypothesis("half-turned", "the camera is turned by 180 degrees", "turn the images", _with_steps(-1, -1)),
        Hypothesis("transposed", "rows and columns of the radiographs are exchanged", "transpose the images",
                   _with_steps(1, 1, swapped=True)),
        Hypothesis("quarter-turned", "the camera is turned by 90 degrees", "turn the images",
                   _with_steps(1, -1, swapped=True)),
        Hypothesis("quarter-turned-back", "the camera is turned by -90 degrees", "turn the images",
                   _with_steps(-1, 1, swapped=True)),
        Hypothesis("order-reversed", "the radiographs are in reverse order", _IN_ORDER, _reversed),
        Hypothesis("sorted-as-text", "the radiographs are sorted as text: 0, 1, 10, 11, ..., 2", _IN_ORDER,
                   _sorted_as_text),
        Hypothesis("start-at-90", "the angles start 90 degrees later", _ANGLES_KEY, _shifted_start(90.0)),
        Hypothesis("start-at-180", "the angles start 180 degrees later", _ANGLES_KEY, _shifted_start(180.0)),
        Hypothesis("start-at-270", "the angles start 90 degrees earlier", _ANGLES_KEY, _shifted_start(-90.0)),
    )
})  # fmt: skip
"""All hypotheses by name."""


def corrected(geometry: Geometry, fixes: tuple[str, ...] | list[str]) -> Geometry:
    """A geometry changed by the named hypotheses, in turn."""
    for name in fixes:
        if name not in HYPOTHESES:
            raise InputError("fixes", f"'{name}' is unknown", f"known names are {', '.join(HYPOTHESES)}")
        geometry = HYPOTHESES[name].change(geometry)
    return geometry
