"""Places, orientations and velocities of bodies in the states of an experiment.

A state's motion carries a body's centre C of the reference to x = Ω (C − c) + u + c (with a strain, F instead of Ω),
and its axes P, from the body's frame to that of the sample, to R = Ω P.  Velocities are those between a state and the
one before it, as mean values: v = Δx/Δt, and ω with exp[ω Δt]ₓ = R R₀⁻¹, where R₀ is that of the state before, both in
the sample frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grainmotion._typing import Float
from grainmotion.analysis.deformed_volume import WITHOUT_MOTION
from grainmotion.grain_shapes.mass_properties import MassProperties
from grainmotion.model.motions import Motions
from grainmotion.rotations import apply_motion

if TYPE_CHECKING:
    import pandas as pd

REFERENCE_STATE = "reference"


@dataclass(frozen=True, eq=False)
class State:
    """A later state: its name, its time in seconds since the reference scan, and its motions."""

    name: str
    motions: Motions
    time: float | None = None


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of n bodies in one state, sample frame; NaN where the state has no motion of a body.

    Attributes
    ----------
    state : str
        Name of the state; "reference" for the reference.
    labels : (n,) int array
    positions : (n, 3) array
        Centres of the bodies' volumes, mm, x y z.
    matrices : (n, 3, 3) array
        Rotations from the bodies' frames to that of the sample.
    velocities, angular_velocities : (n, 3) array
        Between the state before and this one: mm and radians per ``per``; NaN in the reference.
    per : {"s", "step"}
        Whether velocities are per second, or per step from one state to the next.
    statuses : (n,) array of str
    ok_translation, ok_rotation : (n,) bool array
        As of the motions.
    """

    state: str
    time: float | None
    labels: NDArray[np.int64]
    positions: Float
    matrices: Float
    velocities: Float
    angular_velocities: Float
    per: str
    statuses: NDArray[np.str_]
    ok_translation: NDArray[np.bool_]
    ok_rotation: NDArray[np.bool_]

    @property
    def quaternions(self) -> Float:
        """Unit quaternions ``(n, 4)``, w x y z with w ≥ 0; NaN where there is no orientation."""
        out = np.full((len(self.labels), 4), np.nan)
        known = np.isfinite(self.matrices).all(axis=(1, 2))
        if known.any():
            found = Rotation.from_matrix(self.matrices[known]).as_quat(canonical=True)
            out[known] = found[:, [3, 0, 1, 2]]
        return out


def poses(properties: dict[int, MassProperties], states: Sequence[State]) -> list[Poses]:
    """Poses of bodies in the reference and in all states, in their order.

    Parameters
    ----------
    properties : dict
        Mass properties of the bodies in the reference state, by label.
    states : sequence of State
        Later states, in their order.

    Returns
    -------
    list of Poses
        The reference first.
    """
    labels = np.array(sorted(properties), dtype=np.int64)
    n = len(labels)
    centers = np.array([properties[label].center for label in labels.tolist()]).reshape(n, 3)
    axes = np.array([properties[label].principal_axes for label in labels.tolist()]).reshape(n, 3, 3)
    nothing, yes = np.full((n, 3), np.nan), np.ones(n, dtype=bool)
    known = np.full(n, REFERENCE_STATE)
    found = [Poses(REFERENCE_STATE, 0.0, labels, centers, axes, nothing, nothing, "s", known, yes, yes)]
    for state in states:
        motions, before = state.motions.for_grains(labels, centers), found[-1]
        lost = np.isin(motions.statuses, WITHOUT_MOTION)
        positions = apply_motion(motions.gradients, motions.translations, motions.centers, centers)
        matrices = motions.matrices @ axes
        positions[lost], matrices[lost] = np.nan, np.nan
        timed = state.time is not None and before.time is not None
        step = float(state.time - before.time) if state.time is not None and before.time is not None else 1.0
        turn = matrices @ before.matrices.transpose(0, 2, 1)
        found.append(Poses(
            state.name, state.time, labels, positions, matrices, (positions - before.positions) / step,
            _vectors(turn) / step, "s" if timed else "step", motions.statuses,
            motions.ok_translation, motions.ok_rotation,
        ))  # fmt: skip
    return found


def _vectors(matrices: Float) -> Float:
    """Rotation vectors ``(n, 3)``, radians; NaN of NaN."""
    out = np.full((len(matrices), 3), np.nan)
    known = np.isfinite(matrices).all(axis=(1, 2))
    if known.any():
        out[known] = Rotation.from_matrix(matrices[known]).as_rotvec()
    return out


def pose_table(found: Sequence[Poses]) -> pd.DataFrame:
    """The table of ``poses.csv``: one row for each state and body, mm and degrees, NaN left empty."""
    import pandas as pd  # takes half a second and 60 MB

    return pd.concat([_rows(p) for p in found], ignore_index=True)


def _rows(p: Poses) -> pd.DataFrame:
    import pandas as pd  # takes half a second and 60 MB

    vectors = np.rad2deg(_vectors(p.matrices))
    columns: dict[str, object] = {"state": p.state, "time": np.nan if p.time is None else p.time, "label": p.labels}
    columns |= {name: p.positions[:, k] for k, name in enumerate(("x", "y", "z"))}
    columns |= {name: p.quaternions[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))}
    columns |= {name: vectors[:, k] for k, name in enumerate(("rx", "ry", "rz"))}
    columns |= {name: p.velocities[:, k] for k, name in enumerate(("vx", "vy", "vz"))}
    spin = np.rad2deg(p.angular_velocities)
    columns |= {name: spin[:, k] for k, name in enumerate(("spin_x", "spin_y", "spin_z"))}
    columns |= {"velocity_per": p.per if p.state != REFERENCE_STATE else "", "status": p.statuses}
    columns |= {"ok_translation": p.ok_translation, "ok_rotation": p.ok_rotation}
    return pd.DataFrame(columns)
