"""What the default stages take: evaluations and rays are counted, so that no change makes them more unseen."""

from unittest import mock

import numpy as np
import pytest

import few_grains
from grainmotion.kernels import grain_projection as kernel
from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.tracking.track import track


@pytest.fixture(scope="module")
def counts():
    """Of one state of five grains, 14 voxels across, 4 views: linearisations, simulations, rays by kind."""
    grains = few_grains.grain_set()
    truth = few_grains.small_motions(grains)
    scan = few_grains.radiographs(grains, truth)
    found = {"linearize": 0, "cost": 0, "project": 0, "project_with_derivatives": 0}

    def counting(inner, name, size):
        def run(*arguments):
            found[name] += size(*arguments)
            return inner(*arguments)

        return run

    def rays(grains, views, patches, *rest):
        return int((patches.lines[:, 3] - patches.lines[:, 2]).sum())

    walks = {name: counting(getattr(kernel, name), name, rays) for name in ("project", "project_with_derivatives")}
    own = {name: counting(getattr(StateProblem, name), name, lambda *_: 1) for name in ("linearize", "cost")}
    with mock.patch.multiple(kernel, **walks), mock.patch.multiple(StateProblem, **own):
        measured = track(grains, scan)
    assert measured.ok.all()
    return found | {"steps": len(measured.fit.costs)}


def test_linearisations(counts):
    """A step is not linearised where it ends if nothing more is expected there."""
    assert counts["linearize"] <= 18
    assert counts["linearize"] <= counts["steps"] + 4
    assert counts["cost"] >= 4


def test_rays(counts):
    """A grain shades some 300 pixels of a view: about a dozen walks with derivatives, and some more without."""
    assert counts["project_with_derivatives"] <= 83_000
    assert counts["project"] <= 120_000


def test_a_grain_s_corners_are_not_walked():
    grains = few_grains.grain_set(sphere=1)
    packed = GrainArrays.of(grains).select([0])
    patches = footprint_patches(packed, Pose(np.zeros((1, 3)), np.eye(3)[None]), few_grains.geometry())
    walked = int((patches.jobs[:, 3] - patches.jobs[:, 2]).sum())
    assert walked < 0.88 * patches.offsets[-1]
