"""Fabric of a packing: how contacts are directed, and how many a grain has."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.contacts import INDETERMINATE, TOUCHING, Contacts
from grainmotion.model.summary import Summarised, Summary

Directions = Literal["normals", "branches"]


@dataclass(frozen=True, eq=False, repr=False)
class Fabric(Summarised):
    """Directions and number of the contacts of one state.

    Attributes
    ----------
    directions : {"normals", "branches"}
        Vectors that were counted: contact normals or branch vectors, as unit vectors.
    contacts, grains : int
        Contacts that were counted; grains whose contacts are all seen (not at the border of the field).
    first_kind : (3, 3) array
        N = ⟨n nᵀ⟩, trace 1; I/3 for isotropic directions.
    second_kind : (3, 3) array
        F = 15/2 (N − I/5), of the density (1/4π) F_ij n_i n_j.
    third_kind : (3, 3) array
        D = 15/2 (N − I/3), traceless: of the density (1/4π) (1 + D_ij n_i n_j).
    anisotropy : float
        √(3/2 D : D), as spam's `fabricTensor`; 0 for isotropic directions.
    isotropic_anisotropy : float
        Root mean square of the anisotropy that as many random directions show: 7.5/√contacts.
    coordination : float
        Mean number of contacts of the grains.
    coordination_bounds : (float, float)
        The same if no, and if every, indeterminate pair is a contact.
    mechanical_coordination : float
        Mean number of contacts of the grains with two or more (Thornton, Géotechnique 50, 43, 2000).
    rattlers : int
        Grains with no or one contact.

    Examples
    --------
    >>> fabric = gm.fabric(gm.contacts(grains))
    >>> fabric.grains, fabric.first_kind.shape
    (4, (3, 3))
    """

    directions: Directions
    contacts: int
    grains: int
    first_kind: Float
    second_kind: Float
    third_kind: Float
    anisotropy: float
    isotropic_anisotropy: float
    coordination: float
    coordination_bounds: tuple[float, float]
    mechanical_coordination: float
    rattlers: int

    def _summary(self) -> Summary:
        line = (
            f"{self.contacts} {self.directions} of {self.grains} grains; anisotropy {self.anisotropy:.3g}, by chance "
            f"{self.isotropic_anisotropy:.3g}; {self.coordination:.3g} contacts a grain"
        )
        return replace(super()._summary(), line=line)

    def to_dict(self) -> dict[str, object]:
        """Plain data as JSON holds it, all fields by name; what is not known (NaN) is null.

        Returns
        -------
        dict
            Numbers, lists and text.
        """
        return {key: _plain(value) for key, value in asdict(self).items()}


@checked_arguments
def fabric(contacts: Contacts, *, directions: Directions = "normals") -> Fabric:
    """Fabric tensors, anisotropy and coordination number of the contacts of a state.

    Tensors as Kanatani (International Journal of Engineering Science 22, 149, 1984) defines them.  Contacts with
    pistons and walls (`body_contacts`) do not count.  Grains at the border of the field of view do not count for the
    coordination number, but their contacts with others do.

    Parameters
    ----------
    contacts : Contacts
        Of one state.  Pairs that are indeterminate count as no contacts; ``coordination_bounds`` tell what they add.
    directions : {"normals", "branches"}
        Which vectors to count.  Normals are those of the surfaces, branch vectors join the centres of mass.

    Returns
    -------
    Fabric
        NaN where there are no contacts, or no grains away from the border.

    Raises
    ------
    InputError
        If ``directions`` is unknown.

    Examples
    --------
    >>> fabric = gm.fabric(gm.contacts(grains), directions="branches")
    >>> fabric.first_kind.shape
    (3, 3)
    """
    if directions not in ("normals", "branches"):
        raise InputError("fabric.directions", f"'{directions}' is unknown", 'use "normals" or "branches"')
    vectors = (contacts.normals if directions == "normals" else contacts.branches)[contacts.touching]
    units = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    count = len(units)
    first = units.T @ units / count if count else np.full((3, 3), np.nan)
    third = 7.5 * (first - np.eye(3) / 3)
    inner = ~contacts.at_border
    sure, perhaps = (_counts(contacts, kind)[inner] for kind in (TOUCHING, INDETERMINATE))
    return Fabric(
        directions, count, int(inner.sum()), first, 7.5 * (first - np.eye(3) / 5), third,
        float(np.sqrt(1.5 * (third**2).sum())), 7.5 / np.sqrt(count) if count else float("nan"), _mean(sure),
        (_mean(sure), _mean(sure + perhaps)), _mean(sure[sure > 1]), int((sure < 2).sum()),
    )  # fmt: skip


def _counts(contacts: Contacts, kind: str) -> Float:
    """Pairs of one kind that each grain has, ``(n,)``."""
    ends, times = np.unique(contacts.pairs[contacts.kinds == kind], return_counts=True)
    found = dict(zip(ends.tolist(), times.tolist(), strict=True))
    return np.array([found.get(int(label), 0) for label in contacts.labels], dtype=float)


def _mean(values: Float) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return None if np.isnan(value) else float(value)
    return value
