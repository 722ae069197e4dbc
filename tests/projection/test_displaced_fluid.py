"""What grains add to a liquid's image at a pose: dry and wet grains, and grains that cross the level."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from grainmotion.model.fluid import FluidFit
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.state_fit import StateFit
from grainmotion.projection.displaced_fluid import Submersion
from grainmotion.projection.grains import simulate_radiographs
from wet_sample import EXCESS, LIQUID, in_liquid, radiographs, reference, stones

STILL = Pose(np.zeros((6, 3)), np.tile(np.eye(3), (6, 1, 1)))


@cache
def grains():
    return reference(stones())


@cache
def wet():
    return Submersion(grains())


def fluid():
    return grains().scene.fluid


def masses(grains):
    return np.array([g.volume.array.sum(dtype=float) for g in grains.grains])


def test_in_the_same_liquid_grains_keep_their_excess():
    same = wet().effective(fluid(), 1.0, STILL)
    assert all(a is b for a, b in zip(same.grains, grains().grains, strict=True))


def test_solid_grains_that_fall_dry_have_all_their_attenuation():
    dry = wet().effective(fluid().changed(LIQUID, -1e3), 1.0, STILL)
    np.testing.assert_allclose(masses(dry) / masses(grains()), (EXCESS + LIQUID) / EXCESS, rtol=0.03)
    fine = [d.fine.array.sum(dtype=float) / g.fine.array.sum(dtype=float) for d, g in zip(dry.grains, grains().grains)]
    np.testing.assert_allclose(fine, (EXCESS + LIQUID) / EXCESS, rtol=0.03)


def test_porous_grains_keep_their_excess_when_they_fall_dry():
    np.testing.assert_array_equal(masses(wet().effective(fluid().changed(LIQUID, -1e3), 0.0, STILL)), masses(grains()))


def test_a_level_changes_the_grains_above_it_alone():
    level = wet().effective(fluid().changed(LIQUID, 0.0), 1.0, STILL)
    ratios = masses(level) / masses(grains())
    np.testing.assert_allclose(ratios[:3], 1.0, atol=1e-6)
    assert (ratios[3:] > 1.5).all()


def test_a_grain_that_rises_out_of_the_liquid_is_changed_where_it_is_now():
    up = Pose(np.array([[0, 0, 2.2]] * 6), STILL.matrices)
    ratios = masses(wet().effective(fluid().changed(LIQUID, 0.0), 1.0, up)) / masses(grains())
    assert (ratios > 1.5).all()


@pytest.mark.parametrize("level", [None, 0.05])
def test_radiographs_are_of_the_liquid_that_a_state_found(level):

    scan = radiographs(in_liquid(stones(), LIQUID, level))
    nan = float("nan")
    fit = StateFit(fluid=FluidFit(LIQUID, nan if level is None else level, 0.0))
    motions = dataclasses.replace(Motions.identity(grains().labels, grains().centers), fit=fit)
    simulated = simulate_radiographs(grains(), motions, scan.geometry)
    error = np.sqrt(np.mean((simulated - scan.line_integrals) ** 2))
    assert error < 0.04 * np.sqrt(np.mean(scan.line_integrals**2))
