"""All of the mechanics of one state, or of the reference, by the settings of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grainmotion.mechanics.body_contacts import BodyContacts, body_contacts
from grainmotion.mechanics.contact_changes import ContactChanges, contact_changes
from grainmotion.mechanics.contacts import TOUCHING, Contacts, contacts
from grainmotion.mechanics.fabric import fabric
from grainmotion.mechanics.finite_strain import Deformation, deviatoric_noise, propagated, standard_deviations
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.mechanics.strains import Strains, strains
from grainmotion.mechanics.void_ratio import VoidRatios, void_ratio
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.progress import detail
from grainmotion.model.volume import Volume


@dataclass(frozen=True, eq=False)
class StateMechanics:
    """Contacts and void ratios of the reference or of a state; of a state strains and changes of contacts as well."""

    contacts: Contacts
    bodies: BodyContacts
    voids: VoidRatios
    strains: Strains | None = None
    changes: ContactChanges | None = None

    @property
    def summary(self) -> dict[str, object]:
        """The sample as a whole, as JSON holds it: strain, contacts, fabric, void ratio; null where not known."""
        found: dict[str, object] = {}
        if self.strains is not None:
            found["strain"] = _whole(self.strains)
        names, counts = np.unique(self.contacts.kinds, return_counts=True)
        found["pairs"] = dict(zip(names.tolist(), counts.tolist(), strict=True))
        if self.changes is not None:
            names, counts = np.unique(self.changes.changes, return_counts=True)
            found["changes"] = dict(zip(names.tolist(), counts.tolist(), strict=True))
        found["contacts_with_bodies"] = {
            str(name): int(np.count_nonzero((self.bodies.bodies == name) & (self.bodies.kinds == TOUCHING)))
            for name in np.unique(self.bodies.bodies)
        }
        found["fabric_of_normals"] = fabric(self.contacts).to_dict()
        found["fabric_of_branches"] = fabric(self.contacts, directions="branches").to_dict()
        mean = self.voids.mean
        found["void_ratio"] = {"mean": None if np.isnan(mean) else mean, "cells": int(self.voids.inside.sum())}
        found["left_out"] = {str(label): reason for label, reason in self.contacts.left_out}
        return found


def reference_mechanics(grains: GrainSet, grid: Volume, settings: MechanicsSettings) -> StateMechanics:
    """Contacts and void ratios of the reference."""
    detail("contacts", 0, 2)
    pairs = contacts(grains, tolerance=settings.tolerance)
    detail("bodies and voids", 1, 2)
    return StateMechanics(
        pairs,
        body_contacts(grains, tolerance=settings.tolerance),
        void_ratio(grains, grid, cells=settings.cells),
    )


def state_mechanics(
    grains: GrainSet, grid: Volume, motions: Motions, before: Contacts, settings: MechanicsSettings
) -> StateMechanics:
    """Strains, contacts, their changes since the reference (``before``) and void ratios of a state."""
    detail("contacts", 0, 2)
    after = contacts(grains, motions, tolerance=settings.tolerance)
    detail("bodies, voids and strains", 1, 2)
    return StateMechanics(
        after,
        body_contacts(grains, motions, tolerance=settings.tolerance),
        void_ratio(grains, grid, motions, cells=settings.cells),
        strains(motions, estimator=settings.estimator, reach=settings.reach),
        contact_changes(before, after, motions),
    )


def _whole(found: Strains) -> dict[str, object]:
    """F of the whole sample and what follows from it, with standard deviations."""
    gradient, covariance = found.mean_gradient[None], found.mean_covariance[None]
    whole = Deformation(gradient)
    volumetric_sd = standard_deviations(propagated(lambda d: d.volumetric[:, None], gradient, covariance))[0, 0]
    numbers = {
        "volumetric": whole.volumetric[0], "sd_volumetric": volumetric_sd, "deviatoric": whole.deviatoric[0],
        "deviatoric_noise": deviatoric_noise(covariance)[0],
    }  # fmt: skip
    gradient_list = None if np.isnan(gradient).any() else gradient[0].tolist()
    return {"F": gradient_list, **{name: None if np.isnan(x) else float(x) for name, x in numbers.items()}}
