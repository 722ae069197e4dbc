"""Levels of binned radiographs and grains (`tracking.multistage`)."""

import numpy as np

import few_grains
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, project_patches
from grainmotion.tracking.multiresolution import FREE_GRAIN_PIXELS
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.track import TrackSettings

PACKED = GrainArrays.of(few_grains.grain_set(finer=1))
VIEWS = few_grains.geometry()
STILL = Pose(np.zeros((5, 3)), np.broadcast_to(np.eye(3), (5, 3, 3)).copy())


def images(grains, views):
    patches = footprint_patches(grains, STILL, views)
    return assemble(project_patches(grains, STILL, views, patches, "trilinear"), patches, views)


class TestLevels:
    def test_wide_filters_use_binned_radiographs(self):
        """Grains 14 voxels across: fields are fitted on pixels twice as large, free grains on those of the panel."""
        fit = MultistageFit.of(few_grains.grain_set(), Scan(images(PACKED, VIEWS), VIEWS), TrackSettings())
        _, field = fit.level(12.0, least=6.0)
        _, free = fit.level(6.0)
        assert field.scan.geometry.shape == tuple(-(-k // 2) for k in VIEWS.shape)
        assert free.scan.geometry.shape == VIEWS.shape
        assert 2 * float(np.median(PACKED.radii)) / few_grains.VOXEL < 2 * FREE_GRAIN_PIXELS

    def test_levels_are_made_once(self):
        fit = MultistageFit.of(few_grains.grain_set(), Scan(images(PACKED, VIEWS), VIEWS), TrackSettings())
        one, other = fit.level(12.0, least=6.0), fit.level(13.0, least=6.0)
        assert one[0] is other[0]
        assert one[1].scan is other[1].scan
