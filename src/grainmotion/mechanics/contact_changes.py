"""What became of contacts between the reference and a state: kept, gained, lost; and how grains slid and rolled there.

The relative displacement at a contact is that of the two material points that are at it, x_j − x_i: along the normal
(positive when they part) and across it (sliding).  A finite step has two contact points, one in each state: points that
are at it in the reference part afterwards, points that are at it in the state were apart before.  The mean of both
displacements is taken, which is right to third order in the angle by which one grain rolls around the other; each alone
is wrong in second order.  A common rigid motion of both grains gives exactly zero.

Relative rotation, θ of Ω_j Ω_iᵀ: about the normal it is twisting, across it rolling (Iwashita and Oda, Journal of
Engineering Mechanics 124, 285, 1998; for the parts of a relative motion see Kuhn and Bagi, International Journal of
Solids and Structures 41, 5793, 2004).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.columns import CHANGE_COLUMNS, CHANGES_CONTENT
from grainmotion.mechanics.contacts import INDETERMINATE, OPEN, OVERLAP, TOUCHING, Contacts
from grainmotion.model.described_table import described
from grainmotion.model.motions import Motions
from grainmotion.model.summary import Summarised
from grainmotion.rotations import apply_motion, rotation_matrix, rotation_vector, skew_matrix

if TYPE_CHECKING:
    import pandas as pd

KEPT, GAINED, LOST, UNKNOWN = "kept", "gained", "lost", "unknown"

SAME_PLACE = 1e-6
"""Of the distance between centres: places that differ by less are the same."""


@dataclass(frozen=True, eq=False, repr=False)
class ContactChanges(Summarised):
    """Pairs near each other in the reference or in the state, and what happened between them.

    Attributes
    ----------
    pairs : (m, 2) int array
        Labels.
    changes : (m,) array of str
        ``kept``, ``gained``, ``lost``, ``open`` (in neither), ``indeterminate`` (the gap may be on either side of the
        tolerance in one of them), ``overlap`` (one of the motions is wrong) or ``unknown`` (a grain of the pair has no
        motion to use).
    reference_gaps, state_gaps : (m,) arrays
        Gaps, mm; NaN where the pair is not near.
    normal_displacements, normal_sds : (m,) arrays
        Relative displacement along the normal, mm, positive when the grains part, and its standard deviation.
    slidings : (m, 3) array
        Relative displacement across the normal, of the second grain over the first, mm, frame of the state.
    sliding_sds : (m,) array
        Its standard deviation along its own direction; without sliding, of any component across the normal.
    rollings, twistings : (m,) arrays
        Angle of the relative rotation, of the second grain against the first, across the normal (0 or more) and about
        it (right-hand rule about the normal from first to second), radians.
    rolling_sds, twisting_sds : (m,) arrays
        Their standard deviations, radians.

    Examples
    --------
    >>> changes = gm.contact_changes(gm.contacts(grains), gm.contacts(grains, motions), motions)
    >>> set(changes.changes) <= {"kept", "gained", "lost", "open", "indeterminate", "overlap", "unknown"}
    True
    """

    pairs: NDArray[np.int64]
    changes: NDArray[np.str_]
    reference_gaps: Float
    state_gaps: Float
    normal_displacements: Float
    normal_sds: Float
    slidings: Float
    sliding_sds: Float
    rollings: Float
    rolling_sds: Float
    twistings: Float
    twisting_sds: Float

    def __len__(self) -> int:
        return len(self.pairs)

    def to_dataframe(self) -> pd.DataFrame:
        """One row a pair, mm and degrees.

        Returns
        -------
        DataFrame
            Its ``attrs`` tell units and meanings of the columns, frame and version.
        """
        import pandas as pd  # takes half a second

        columns: dict[str, object] = {"label_1": self.pairs[:, 0], "label_2": self.pairs[:, 1], "change": self.changes}
        columns |= {"gap_reference": self.reference_gaps, "gap_state": self.state_gaps}
        columns |= {"normal_displacement": self.normal_displacements, "sd_normal_displacement": self.normal_sds}
        columns |= {f"sliding_{axis}": c for axis, c in zip("xyz", self.slidings.T, strict=True)}
        columns |= {"sliding": np.linalg.norm(self.slidings, axis=1), "sd_sliding": self.sliding_sds}
        for name, values, sds in (
            ("rolling", self.rollings, self.rolling_sds), ("twisting", self.twistings, self.twisting_sds)
        ):  # fmt: skip
            columns |= {name: np.rad2deg(values), f"sd_{name}": np.rad2deg(sds)}
        return described(pd.DataFrame(columns), CHANGE_COLUMNS, CHANGES_CONTENT)


@checked_arguments
def contact_changes(reference: Contacts, state: Contacts, motions: Motions) -> ContactChanges:
    """Which contacts were kept, gained and lost, and the relative motion of the grains there.

    Parameters
    ----------
    reference, state : Contacts
        Of the same grains, by `contacts` without and with motions.
    motions : Motions
        Those of the state.

    Returns
    -------
    ContactChanges
        A row for every pair that is near in either.

    Raises
    ------
    InputError
        If the contacts of the state or the motions are of other grains, or the contacts are exchanged.

    Examples
    --------
    >>> before, after = gm.contacts(grains), gm.contacts(grains, motions)
    >>> changes = gm.contact_changes(before, after, motions)
    >>> len(changes) == len(changes.to_dataframe())
    True
    """
    for name, labels in (("state", state.labels), ("motions", motions.labels)):
        if len(labels) and len(reference.labels) and not np.isin(labels, reference.labels).any():
            raise InputError(
                f"contact_changes({name})", "none of its grains is in reference", "give those of one sample"
            )
    _check_moved(state, motions)
    pairs = np.unique(np.concatenate([reference.pairs, state.pairs]), axis=0)
    rows = [_rows_of(contacts, pairs) for contacts in (reference, state)]
    kinds = [_at(contacts.kinds, row, OPEN) for contacts, row in zip((reference, state), rows, strict=True)]
    known = np.asarray(np.isin(pairs, state.labels).all(axis=1))
    gaps = [_at(contacts.gaps, row, np.nan) for contacts, row in zip((reference, state), rows, strict=True)]
    places = [
        _at(values, row, np.nan)
        for contacts, row in zip((reference, state), rows, strict=True)
        for values in (contacts.points, contacts.normals)
    ]
    return ContactChanges(
        pairs, _changes(kinds[0], kinds[1], known), *gaps, *_relative_motions(motions, pairs, known, places)
    )


def _check_moved(state: Contacts, motions: Motions) -> None:
    """Refuse contacts whose grains stand where they stood in the reference, although they moved: an exchange."""
    row_of = {int(label): row for row, label in enumerate(motions.labels)}
    ends = np.array([[row_of.get(int(label), -1) for label in pair] for pair in state.pairs], np.int64).reshape(-1, 2)
    known: NDArray[np.bool_] = np.asarray((ends >= 0).all(axis=1))
    known[known] &= np.isfinite(motions.translations[ends[known]]).all(axis=(1, 2))
    if not known.any():
        return
    first, second = ends[known].T
    still = motions.centers[second] - motions.centers[first]
    moved = still + motions.translations[second] - motions.translations[first]
    size = float(np.abs(still).max())
    off_still, off_moved = (float(np.abs(state.branches[known] - branch).max()) for branch in (still, moved))
    if off_still < SAME_PLACE * size and off_moved > 1e3 * SAME_PLACE * size:
        remedy = "give contacts(grains) first, then contacts(grains, motions)"
        raise InputError("contact_changes(state)", "its grains stand where they stood in the reference", remedy)


def _rows_of(contacts: Contacts, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of each pair, −1 where it is not listed."""
    row_of = {(int(a), int(b)): row for row, (a, b) in enumerate(contacts.pairs)}
    return np.array([row_of.get((int(a), int(b)), -1) for a, b in pairs], dtype=np.int64)


def _at(values: NDArray, rows: NDArray[np.int64], missing: object) -> NDArray:
    """Values at rows, ``missing`` at rows of −1."""
    found = np.full((len(rows), *values.shape[1:]), missing, dtype=values.dtype)
    found[rows >= 0] = values[rows[rows >= 0]]
    return found


def _changes(before: NDArray[np.str_], after: NDArray[np.str_], known: NDArray[np.bool_]) -> NDArray[np.str_]:
    changes = np.full(len(before), INDETERMINATE, dtype="<U13")
    for was, became, name in (
        (TOUCHING, TOUCHING, KEPT), (OPEN, TOUCHING, GAINED), (TOUCHING, OPEN, LOST), (OPEN, OPEN, OPEN)
    ):  # fmt: skip
        changes[(before == was) & (after == became)] = name
    changes[after == OVERLAP] = OVERLAP
    changes[~known] = UNKNOWN
    return changes


def _relative_motions(
    motions: Motions, pairs: NDArray[np.int64], known: NDArray[np.bool_], places: list[Float]
) -> tuple[Float, ...]:
    """Normal displacement, sliding, rolling and twisting with their standard deviations; NaN where not known."""
    m = len(pairs)
    row_of = {int(label): row for row, label in enumerate(motions.labels)}
    ends = np.array([[row_of.get(int(label), -1) for label in pair] for pair in pairs], dtype=np.int64).reshape(m, 2)
    whole = known & (ends >= 0).all(axis=1)
    whole[whole] &= motions.ok_rotation[ends[whole]].all(axis=1)
    i, j = ends[whole].T
    point, normal, later_point, later_normal = (place[whole] for place in places)
    matrices, u, c = motions.gradients, motions.translations, motions.centers
    omega = rotation_matrix(motions.rotations)
    theta = rotation_vector(omega[j] @ np.swapaxes(omega[i], 1, 2))
    middle = rotation_matrix(theta / 2) @ omega[i]

    forward = apply_motion(matrices[j], u[j], c[j], point) - apply_motion(matrices[i], u[i], c[i], point)
    material = [np.einsum("nij,nj->ni", np.linalg.inv(matrices[k]), later_point - u[k] - c[k]) + c[k] for k in (i, j)]
    backward = np.einsum("nij,nj->ni", middle, material[0] - material[1])
    moved_normal = np.einsum("nij,nj->ni", middle, normal)
    delta, axis = _mean_of_known(forward, backward), _unit(_mean_of_known(moved_normal, later_normal))
    moved_point = (apply_motion(matrices[i], u[i], c[i], point) + apply_motion(matrices[j], u[j], c[j], point)) / 2
    at = _mean_of_known(moved_point, later_point)

    across = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    sliding = np.einsum("nij,nj->ni", across, delta)
    of_delta = np.zeros((len(i), 3, 3))
    for k in (i, j):
        lever = np.concatenate([np.broadcast_to(np.eye(3), (len(k), 3, 3)), -skew_matrix(at - c[k] - u[k])], axis=2)
        of_delta += lever @ motions.covariances[k] @ np.swapaxes(lever, 1, 2)
    of_theta = motions.covariances[i][:, 3:, 3:] + motions.covariances[j][:, 3:, 3:]
    rolling = np.einsum("nij,nj->ni", across, theta)
    values = (
        np.einsum("ni,ni->n", delta, axis), _sd_along(of_delta, axis), sliding, _sd_across(of_delta, across, sliding),
        np.linalg.norm(rolling, axis=1), _sd_across(of_theta, across, rolling),
        np.einsum("ni,ni->n", theta, axis), _sd_along(of_theta, axis),
    )  # fmt: skip
    return tuple(_spread(value, whole) for value in values)


def _mean_of_known(a: Float, b: Float) -> Float:
    """Mean of two sets of vectors, or the one that is not NaN."""
    return np.where(np.isnan(a), b, np.where(np.isnan(b), a, (a + b) / 2))


def _unit(vectors: Float) -> Float:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _sd_along(covariances: Float, axis: Float) -> Float:
    return np.asarray(np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", axis, covariances, axis), 0.0)))


def _sd_across(covariances: Float, across: Float, vectors: Float) -> Float:
    """Standard deviation of vectors across the normal along their own direction; of any such direction where zero."""
    lengths = np.linalg.norm(vectors, axis=1)
    along = _sd_along(covariances, vectors / np.where(lengths > 0, lengths, 1.0)[:, None])
    total = np.einsum("nij,njk,nik->n", across, covariances, across)
    return np.where(lengths > 0, along, np.sqrt(np.maximum(total / 2, 0.0)))


def _spread(values: Float, rows: NDArray[np.bool_]) -> Float:
    found = np.full((len(rows), *values.shape[1:]), np.nan)
    found[rows] = values
    return found
