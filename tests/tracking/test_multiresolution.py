"""Coarse rays: what they may stand in for, and what is left of the radiographs on them."""

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

GRAINS = few_grains.grain_set()
PACKED = GrainArrays.of(GRAINS)
VIEWS = few_grains.geometry()
STILL = Pose(np.zeros((5, 3)), np.broadcast_to(np.eye(3), (5, 3, 3)).copy())


def images(grains, views):
    patches = footprint_patches(grains, STILL, views)
    return assemble(project_patches(grains, STILL, views, patches, "trilinear"), patches, views)


def target(sigma=4.0, scan=None, **changes):
    scan = scan or Scan(images(PACKED, VIEWS), VIEWS)
    return replace(Target(scan, np.zeros(scan.line_integrals.shape, np.float32), "trilinear", sigma), **changes)


class TestHowCoarse:
    def test_no_finer_than_the_filter_and_no_coarser_than_the_grains(self):
        across = 2 * float(np.median(PACKED.radii)) / few_grains.VOXEL
        assert coarsening(PACKED, target(), 0.7, 1.0) == 1
        assert coarsening(PACKED, target(), 3.2, 1.0) == 3
        assert coarsening(PACKED, target(), 50.0, 4.0) == int(across / 4)
        assert coarsening(PACKED, target(), 50.0, across + 1) == 1

    @pytest.mark.parametrize("change", [{"projector": "exact"}, {"derivatives": "differences"}])
    def test_the_papers_variant_has_its_own_rays_alone(self, change):
        assert coarsening(PACKED, target(**change), 50.0, 1.0) == 1


class TestRadiographs:
    @pytest.mark.parametrize("factor", [2, 3, 4])
    def test_coarse_grains_cast_the_binned_shadows(self, factor):
        """Pixels and voxels of one size: the same shadows, up to what a voxel blurs."""
        coarse = coarsened(target(), factor)
        simulated = images(PACKED.coarsened(factor), coarse.scan.geometry)
        smooth = replace(coarse, sigma=1.0)
        gap = smooth.filtered(simulated) - smooth.filtered(coarse.scan.line_integrals)
        assert np.linalg.norm(gap) < 0.06 * np.linalg.norm(smooth.filtered(simulated))
        assert simulated.sum() * factor**2 == pytest.approx(images(PACKED, VIEWS).sum(), rel=0.02)

    def test_the_filter_covers_what_it_did(self):
        assert coarsened(target(6.0), 3).sigma == 2.0

    def test_as_they_are(self):
        plain = target()
        assert coarsened(plain, 1) is plain

    def test_pixels_that_do_not_count(self):
        valid = np.ones((4, *VIEWS.shape), bool)
        valid[:, :, 20:23] = False
        absurd = images(PACKED, VIEWS)
        absurd[~valid] = 1e3
        found = coarsened(target(scan=Scan(absurd, VIEWS, valid)), 2)
        assert found.scan.line_integrals.max() < 100
        assert not found.valid[:, :, 10].any()  # columns 20 and 21
        assert found.valid[:, :, 12].all()
