"""Contacts with pistons and walls: spheres at known distances of a plate and in a tube."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.mechanics.body_contacts import body_contacts
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.mechanics.state_mechanics import reference_mechanics
from grainmotion.model.scene import Body, Scene
from grainmotion.model.state_fit import BodyMotion
from grainmotion.model.volume import Volume
from spheres import known_motions, sphere_grains

RADIUS, SHAPE = 7.0, (40, 40, 60)
TOP = -8.6  # of the plate, voxels
X, Y, Z = np.meshgrid(*[np.arange(n) - (n - 1) / 2 for n in SHAPE[::-1]], indexing="ij")


def body(name, kind, outside):
    """A body whose surface is where ``outside (x, y, z)``, its height in voxels, is zero."""
    share = np.clip(0.5 - outside, 0, 1).transpose(2, 1, 0)
    return Body(name, kind, Volume(np.ascontiguousarray(share, np.float32), 1.0))


PISTON = body("lower piston", "piston", Z - TOP)


def above(gaps, bodies=(PISTON,)):
    """Spheres whose lowest points are so far above the plate."""
    centers = [(-19.0 + 19 * k, 0.2, TOP + RADIUS + gap) for k, gap in enumerate(gaps)]
    return replace(sphere_grains(centers, [RADIUS] * len(gaps), SHAPE), scene=Scene(tuple(bodies)))


def piston_motion(shift, sd=0.0):
    covariance = np.diag([1.0, 1, 1, 0, 0, 0]) * sd**2
    return BodyMotion("lower piston", "piston", "free", PISTON.center, np.array(shift), np.zeros(3), covariance, True)


def with_piston(motions, shift, sd=0.0):
    return replace(motions, fit=replace(motions.fit, bodies=(piston_motion(shift, sd),)))


def test_gaps_places_and_normals_of_spheres_above_a_plate():
    found = body_contacts(above([0.0, 1.3, 2.2]))
    assert found.labels.tolist() == [1, 2, 3]
    assert set(found.bodies) == {"lower piston"}
    np.testing.assert_allclose(found.gaps, [0.1, 1.35, 2.25], atol=0.25)
    assert found.kinds.tolist() == ["contact", "open", "open"]
    np.testing.assert_allclose(found.normals, [[0, 0, -1]] * 3, atol=0.03)
    np.testing.assert_allclose(found.points[:, 2], TOP + np.array([0.0, 1.3, 2.2]) / 2, atol=0.5)


def test_a_piston_that_moves_up_closes_the_gaps():
    grains = above([0.0, 1.3, 2.2])
    still = known_motions(grains.centers, np.zeros((3, 3)))
    before, after = body_contacts(grains), body_contacts(grains, with_piston(still, [0.0, 0, 1.2]))
    np.testing.assert_allclose(after.gaps - before.gaps, -1.2, atol=1e-6)
    assert after.kinds[1] == "contact"
    deep = body_contacts(grains, with_piston(still, [0.0, 0, 2.5]))
    assert deep.kinds[0] == "overlap"


def test_standard_deviations_hold_the_motions_of_both():
    """0.3 of the grain and 0.4 of the piston along the normal: 0.5, beside 0.1 of the surfaces."""
    grains = above([1.0])
    motions = known_motions(grains.centers, np.zeros((1, 3)))
    motions = replace(motions, covariances=np.diag([1.0, 1, 1, 0, 0, 0])[None] * 0.3**2)
    found = body_contacts(grains, with_piston(motions, np.zeros(3), 0.4))
    assert found.gap_sds[0] == pytest.approx(np.hypot(0.5, 0.1), rel=1e-3)
    assert found.kinds[0] == "indeterminate"


def test_a_common_rigid_motion_changes_nothing():
    grains = above([0.0, 1.3])
    shift = np.array([1.0, -2.0, 0.5])
    motions = with_piston(known_motions(grains.centers, np.tile(shift, (2, 1))), shift)
    before, after = body_contacts(grains), body_contacts(grains, motions)
    np.testing.assert_allclose(after.gaps, before.gaps, atol=1e-6)
    np.testing.assert_allclose(after.points, before.points + shift, atol=1e-6)


def test_a_grain_on_the_axis_of_a_tube_touches_no_wall():
    """The tube's centre of mass is in that grain, its wall is not."""
    wall = body("wall", "wall", 13.0 - np.hypot(X, Y))
    grains = sphere_grains([(0.0, 0, 0)], [6.0], SHAPE)
    assert len(body_contacts(replace(grains, scene=Scene((wall,))))) == 0
    beside = sphere_grains([(6.8, 0, 0)], [6.0], SHAPE)
    found = body_contacts(replace(beside, scene=Scene((wall,))))
    assert found.kinds.tolist() == ["contact"]
    np.testing.assert_allclose(found.normals[0], [1, 0, 0], atol=0.05)


def test_grains_without_a_motion_to_use_and_what_is_no_body_are_left_out():
    grains = above([0.0, 1.3])
    motions = known_motions(grains.centers, np.zeros((2, 3)), statuses=["ambiguous", "absent"])
    assert body_contacts(grains, motions).labels.tolist() == [k for k, ok in zip([1, 2], motions.ok_translation) if ok]
    rest = replace(PISTON, kind="rest")
    assert len(body_contacts(above([0.0], [rest]))) == 0
    assert len(body_contacts(above([0.0], []))) == 0
    assert len(body_contacts(above([0.0], [])).to_dataframe()) == 0


def test_the_summary_counts_them_apart():
    grains = above([0.0, 1.3])
    found = reference_mechanics(grains, Volume.zeros(SHAPE, 1.0), MechanicsSettings(cells="radical")).summary
    assert found["contacts_with_bodies"] == {"lower piston": 1}
    assert found["fabric_of_normals"]["contacts"] == 0


def test_a_tolerance_that_is_not_positive_is_refused():
    with pytest.raises(InputError, match=r"body_contacts\.tolerance"):
        body_contacts(above([0.0]), tolerance=0.0)
