"""More than 100 grains, where the normal matrix is applied as a product: workers give the bits of one process."""

import numpy as np
import pytest

from few_grains import VOXEL
from grainmotion.cluster.connection import ComputeConfig, connect
from grainmotion.cluster.dask_backend import DaskBackend
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.track import TrackSettings, track
from inline_executor import InlineExecutor

GRAIN_VOXELS, GRAINS_PER_SIDE = 8, 5
QUICK = TrackSettings(search=False, fields=False, filters=(2.0, 0.7), iterations=3, device="cpu")


@pytest.fixture(autouse=True)
def always_shared(monkeypatch):
    """Distribute grains to workers even for the small samples of these tests."""
    monkeypatch.setattr("grainmotion.cluster.dask_backend.MIN_VOXELS_TO_SHARE", 0)


def lattice_of_grains():
    """125 polyhedra of 6 voxels on a lattice, in single precision, and noisy radiographs after random motions."""
    rng = np.random.default_rng(0)
    points = np.stack(np.meshgrid(*[np.arange(GRAIN_VOXELS) - 3.5] * 3, indexing="ij"), axis=-1)
    volume = np.zeros((GRAIN_VOXELS * GRAINS_PER_SIDE,) * 3, np.float32)
    labels = np.zeros(volume.shape, np.int32)
    for label, corner in enumerate(np.ndindex(GRAINS_PER_SIDE, GRAINS_PER_SIDE, GRAINS_PER_SIDE), start=1):
        normals = rng.normal(size=(8, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        outside = np.maximum(
            (points @ normals.T - rng.uniform(1.5, 3, 8)).max(axis=-1), np.abs(points).max(axis=-1) - 3
        )
        cell = tuple(slice(GRAIN_VOXELS * k, GRAIN_VOXELS * (k + 1)) for k in corner)
        volume[cell] = np.clip(0.5 - outside, 0, 1)
        labels[cell] = np.where(volume[cell] > 0.3, label, 0)
    grains = grains_from_labels(Volume(volume, VOXEL), labels, background="ignore")
    views = Geometry.cone((0.0, 50.0, 95.0, 140.0), (52, 72), 4 * VOXEL, source_to_axis=40, source_to_detector=160)
    moved = Motions.identity(grains.labels, grains.centers)
    moved.translations[:] = VOXEL * rng.uniform(-0.7, 0.7, (len(grains), 3))
    moved.rotations[:] = np.deg2rad(rng.uniform(-3, 3, (len(grains), 3)))
    images = simulate_radiographs(grains, moved, views)
    return grains, Scan((images + rng.normal(0, 0.005, images.shape)).astype(np.float32), views)


@pytest.fixture(scope="module")
def by_one_process():
    """Grains, scan, and the motions that one process gives."""
    grains, scan = lattice_of_grains()
    assert len(grains) > 100
    assert grains.precision == np.float32
    return grains, scan, track(grains, scan, settings=QUICK)


def assert_same_bits(one, other):
    for name in ("translations", "rotations", "statuses", "covariances", "residuals"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))


@pytest.mark.parametrize("worker_count", [1, 2, 5])
def test_same_bits_with_any_number_of_workers(by_one_process, tmp_path, worker_count):
    grains, scan, one = by_one_process
    assert np.ptp(one.translations) > VOXEL
    backend = DaskBackend(InlineExecutor(worker_count), SharedStore(tmp_path / "store"))
    assert_same_bits(one, track(grains, scan, settings=QUICK, device=backend))
    assert backend.executor.done.count("jvp") > 10 * worker_count
    backend.store.close()


@pytest.mark.slow
def test_same_bits_with_worker_processes(by_one_process, tmp_path):
    pytest.importorskip("distributed")
    grains, scan, one = by_one_process
    with connect(ComputeConfig(workers=2), tmp_path) as cluster:
        assert_same_bits(one, track(grains, scan, settings=QUICK, device=cluster.backend))
