"""Binned radiographs and grains (`tracking.multiresolution`): the factor, images, filter and masks."""

from dataclasses import replace

import numpy as np
import pytest

import few_grains
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.objective.data_term import Target
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.tracking.multiresolution import coarsened, coarsening

PACKED = GrainArrays.of(few_grains.grain_set(finer=1))
VIEWS = few_grains.geometry()
STILL = Pose(np.zeros((5, 3)), np.broadcast_to(np.eye(3), (5, 3, 3)).copy())


def images(grains, views):
    patches = footprint_patches(grains, STILL, views)
    return assemble(project_patches(grains, STILL, views, patches, "trilinear"), patches, views)


def target(sigma=4.0, scan=None, **changes):
    scan = scan or Scan(images(PACKED, VIEWS), VIEWS)
    return replace(Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", sigma), **changes)


class TestFactor:
    def test_factor_is_limited_by_the_filter_and_the_grains(self):
        across = 2 * float(np.median(PACKED.radii)) / few_grains.VOXEL
        assert coarsening(PACKED, target(), 0.7, 1.0) == 1
        assert coarsening(PACKED, target(), 3.2, 1.0) == 3
        assert coarsening(PACKED, target(), 50.0, 4.0) == int(across / 4)
        assert coarsening(PACKED, target(), 50.0, across + 1) == 1

    @pytest.mark.parametrize("change", [{"projector": "exact"}, {"derivatives": "differences"}])
    def test_the_papers_variant_is_not_binned(self, change):
        assert coarsening(PACKED, target(**change), 50.0, 1.0) == 1


class TestRadiographs:
    @pytest.mark.parametrize("factor", [2, 3, 4])
    def test_coarse_grains_have_the_binned_radiographs(self, factor):
        """The projections are the same, but for the blur of a voxel."""
        coarse = coarsened(target(), factor)
        simulated = images(PACKED.coarsened(factor), coarse.scan.geometry)
        smooth = replace(coarse, sigma=1.0)
        difference = smooth.filtered(simulated) - smooth.filtered(coarse.scan.line_integrals)
        assert np.linalg.norm(difference) < 0.06 * np.linalg.norm(smooth.filtered(simulated))
        assert simulated.sum() * factor**2 == pytest.approx(images(PACKED, VIEWS).sum(), rel=0.02)

    def test_the_filter_keeps_its_width(self):
        assert coarsened(target(6.0), 3).sigma == 2.0

    def test_factor_one_changes_nothing(self):
        plain = target()
        assert coarsened(plain, 1) is plain

    def test_masked_pixels_do_not_count(self):
        valid = np.ones((4, *VIEWS.shape), bool)
        valid[:, :, 20:23] = False
        spoiled = images(PACKED, VIEWS)
        spoiled[~valid] = 1e3
        binned = coarsened(target(scan=Scan(spoiled, VIEWS, valid)), 2)
        assert binned.scan.line_integrals.max() < 100
        assert not binned.valid[:, :, 10].any()  # columns 20 and 21
        assert binned.valid[:, :, 12].all()
