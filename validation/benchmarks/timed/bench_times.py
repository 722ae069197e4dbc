"""CPU times of kernels and stages on small cases, kept in ``validation/benchmarks/history`` by `make bench-history`.

Run by pytest-benchmark with `time.process_time` as its clock: user and system time of all threads.  Nothing is
asserted: the bars are the scripts' one folder up, what may not grow unseen is counted in ``tests/work``.
"""

import numpy as np
import pytest
from validation.benchmarks.grain_derivatives import brick, scene, stone

from few_grains import grain_set, radiographs, small_motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import differentiate_patches, project_patches
from grainmotion.projection.volumes import back_project, project
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.simulate import small
from grainmotion.tracking.track import track

CROPS = {"stone": stone, "brick": brick}


def timed(benchmark, work, rounds=15):
    """Time a call, once compiled and warm."""
    benchmark.pedantic(work, rounds=rounds, warmup_rounds=2)


@pytest.mark.parametrize("projector", ["trilinear", "exact"])
@pytest.mark.parametrize("crop", CROPS)
class TestWalks:
    """A crop of 64³ voxels on 128 × 128 pixels."""

    def test_value(self, benchmark, crop, projector):
        s = scene(CROPS[crop](), np.float32)
        timed(benchmark, lambda: project_patches(s.packed, s.pose, s.geometry, s.patches, projector), 40)

    def test_derivatives(self, benchmark, crop, projector):
        s = scene(CROPS[crop](), np.float32)
        timed(benchmark, lambda: differentiate_patches(s.packed, s.pose, s.geometry, s.patches, projector), 40)


@pytest.fixture(scope="module")
def scan():
    """Six views of the small packing's scan."""
    return small(n_grains=3).reference().select(slice(None, None, 15))


@pytest.fixture(scope="module")
def grid():
    """Its grid, all ones."""
    empty = small(n_grains=3).scanner.grid
    return Volume(np.ones(empty.shape, np.float32), empty.voxel_size, empty.center)


class TestVolumes:
    """Six cone-beam views of 96 × 72 pixels, 96 × 72 × 72 voxels."""

    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    def test_forward(self, benchmark, scan, grid, projector):
        timed(benchmark, lambda: project(grid, scan.geometry, projector=projector))

    @pytest.mark.parametrize("projector", ["trilinear", "exact"])
    def test_back(self, benchmark, scan, grid, projector):
        timed(benchmark, lambda: back_project(scan.line_integrals, scan.geometry, grid, projector=projector))

    def test_sweep(self, benchmark, scan: Scan, grid):
        settings = ReconstructSettings(sweeps=1)
        timed(benchmark, lambda: reconstruct(scan, grid, settings), 5)


class TestTracking:
    """Five grains 14 voxels across, 4 views, default settings."""

    def test_packing(self, benchmark):
        grains = grain_set(5)
        timed(benchmark, lambda: GrainArrays.of(grains, fine=True))

    def test_state(self, benchmark):
        grains = grain_set(5)
        scan = radiographs(grains, small_motions(grains))
        timed(benchmark, lambda: track(grains, scan), 5)
