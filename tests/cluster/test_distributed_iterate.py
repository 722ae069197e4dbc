"""`cluster.distributed_iterate`: reconstruction in slabs gives the same bits as that of the whole volume."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from grainmotion.cluster import reconstruction_tasks as tasks
from grainmotion.cluster.distributed_iterate import (
    VIEWS_BETWEEN_CHECKPOINTS,
    DistributedIterate,
    reconstruct_distributed,
)
from grainmotion.cluster.shared_store import SharedStore
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.stacks import find_stack
from grainmotion.io.tiff import read_tiff, write_tiff
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.reconstruction import slabs
from grainmotion.reconstruction.coarse_start import pieces_of
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from inline_executor import InlineExecutor
from tiny_experiment import PANEL, TOML, write_tiny

SETTINGS = {
    "accelerated": ReconstructSettings(method="accelerated"),
    "sart": ReconstructSettings(sweeps=1),
    "exact": ReconstructSettings(projector="exact", sweeps=1),
    "free": ReconstructSettings(method="accelerated", non_negative=False, circular=False),
}


GEOMETRIES = {
    "cone": Geometry.cone(np.arange(0, 360, 20), (50, 40), 0.2, source_to_axis=8, source_to_detector=16),
    "tilted": Geometry.cone(
        np.arange(0, 360, 20), (50, 40), 0.2, source_to_axis=8, source_to_detector=16,
        panel=DetectorAlignment(detector_tilts_deg=(3.0, 2.0, 4.0), detector_offset=(0.3, -0.5)),
    ),
    "parallel, upside down": Geometry.parallel(
        np.arange(0, 180, 10), (50, 40), 0.1, panel=DetectorAlignment(first_row="top")
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return find_inputs(read_experiment(write_tiny(tmp_path_factory.mktemp("scan"))))


@pytest.fixture
def store(tmp_path):
    """A shared store that is closed after the test."""
    store = SharedStore(tmp_path)
    yield store
    store.close()


def layout(geometry, shape=(40, 30, 30), **settings):
    return slabs.Layout.of(Volume.zeros(shape, 0.1), geometry, ReconstructSettings(**settings))


@pytest.fixture(params=[100, 10], ids=["one slab", "slabs"])
def slab_planes(request, monkeypatch):
    """Planes of a slab: one slab for the whole volume, or several."""
    monkeypatch.setattr(slabs, "SLAB_PLANES", request.param)


@pytest.mark.usefixtures("slab_planes")
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS.keys())
def test_same_bits_with_every_method(inputs, store, settings):
    source = inputs.reference
    one = reconstruct(source.read()[0], inputs.grid, settings)
    many = reconstruct_distributed(InlineExecutor(), store, source, inputs.grid, settings, None)
    assert one.volume.array.max() > 0.5
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals
    assert (many.volume.center, many.volume.voxel_size) == (one.volume.center, one.volume.voxel_size)
    assert not list(store.folder.glob("planes*"))


@pytest.mark.usefixtures("slab_planes")
@pytest.mark.parametrize("everywhere", [True, False])
def test_same_bits_with_masked_pixels_and_selected_views(tmp_path, store, everywhere):
    """All views but one, dead pixels in all views or a saturated pixel in one, more subsets than views."""
    path = write_tiny(
        tmp_path / "tiny", TOML.replace('kind = "counts"', "").replace("[volume]", 'views = "1:"\n[volume]')
    )
    if everywhere:
        flats = np.full((1, *PANEL), 50_100, np.uint16)
        flats[:, 10:13, 20:23] = 0
        write_tiff(path.parent / "flats.tif", flats)
    else:
        image = read_tiff(path.parent / "reference" / "8.tif")[0]
        image[11, 20] = 65_535
        write_tiff(path.parent / "reference" / "8.tif", image)
    source = find_inputs(read_experiment(path)).reference
    grid = find_inputs(read_experiment(path)).grid
    settings = ReconstructSettings(method="accelerated")
    scan = source.read()[0]
    assert scan.valid is not None
    assert len(scan) == 39
    one = reconstruct(scan, grid, settings)
    many = reconstruct_distributed(InlineExecutor(), store, source, grid, settings, None)
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals


@pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
@pytest.mark.parametrize("method", ["sart", "accelerated"])
def test_same_bits_with_every_geometry(tmp_path, store, monkeypatch, geometry, method):
    """On a grid smaller than the detector, off the axis and with an odd number of planes."""
    monkeypatch.setattr(slabs, "SLAB_PLANES", 10)
    rng = np.random.default_rng(0)
    np.save(tmp_path / "scan.npy", rng.random((len(geometry), *geometry.shape), np.float32))
    source = ScanInput("scan", find_stack(tmp_path / "scan.npy"), None, None, "line-integrals", geometry)
    grid, settings = Volume.zeros((31, 27, 29), 0.1, (0.2, -0.1, 0.3)), ReconstructSettings(method=method)
    one = reconstruct(source.read()[0], grid, settings)
    many = reconstruct_distributed(InlineExecutor(), store, source, grid, settings, None)
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals


def test_same_bits_with_a_coarse_start_in_pieces(tmp_path, store, monkeypatch):
    """A distant tilted detector with an odd number of pixels."""
    monkeypatch.setattr(slabs, "SLAB_PLANES", 20)
    panel = DetectorAlignment(detector_tilts_deg=(1.0, 0.5, 0.5), detector_offset=(0.3, -0.5))
    far = {"source_to_axis": 600, "source_to_detector": 1200, "panel": panel}
    geometry = Geometry.cone(np.arange(0, 360, 10), (165, 61), 0.2, **far)
    np.save(tmp_path / "scan.npy", np.random.default_rng(0).random((36, 165, 61), np.float32))
    source = ScanInput("scan", find_stack(tmp_path / "scan.npy"), None, None, "line-integrals", geometry)
    grid, settings = Volume.zeros((80, 40, 40), 0.1), ReconstructSettings(method="accelerated")
    assert len(pieces_of(slabs.Layout.of(grid, geometry, settings))) > 1
    one = reconstruct(source.read()[0], grid, settings)
    many = reconstruct_distributed(InlineExecutor(), store, source, grid, settings, None)
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals


def test_slabs_are_stored_at_checkpoints(inputs, store, monkeypatch):
    monkeypatch.setattr(slabs, "SLAB_PLANES", 10)
    executor = InlineExecutor()
    reconstruct_distributed(
        executor, store, inputs.reference, inputs.grid, ReconstructSettings(method="accelerated"), None
    )
    views_used = 44 * 8 + 8 * 16
    assert executor.done.count("restored") == 2 * (
        (views_used - 1) // VIEWS_BETWEEN_CHECKPOINTS
    )  # none after the last update
    assert len(list(store.folder.glob("slab-*"))) <= 2


@pytest.mark.parametrize("momentum", [0.0, 0.9])
def test_state_is_restored_from_memory_or_from_its_file(tmp_path, momentum):
    """A state that is still in memory is not read from its file."""
    slab_layout = layout(GEOMETRIES["cone"])
    image = np.random.default_rng(0).random(slab_layout.shape, np.float32)
    slab = slabs.new_slab(slab_layout, 0, image)
    state = tasks.SlabState(replace(slab, before=2 * slab.image if momentum else None), np.ones((50, 2)))
    tasks.store(state, tmp_path / "slab")
    in_memory = tasks.restored(slab_layout, 0, tmp_path / "slab", momentum)
    assert in_memory.slab is state.slab
    del state, in_memory
    from_file = tasks.restored(slab_layout, 0, tmp_path / "slab", momentum)
    assert from_file.slab is not slab
    np.testing.assert_array_equal(from_file.slab.image, slab.image)
    np.testing.assert_array_equal(from_file.slab.planes, 2 * image if momentum else image)


def test_workers_read_each_radiograph_once(inputs, store):
    executor = InlineExecutor()
    DistributedIterate(executor, store, inputs.reference, inputs.grid, ReconstructSettings(sweeps=1))
    assert executor.done.count("load_views") == 3  # 40 views, 16 in each task


class TestSlabs:
    def test_slabs_cover_the_volume(self):
        for shape, count in (
            ((1, 4, 4), 1), ((28, 4, 4), 1), ((280, 180, 180), 2), ((280, 4, 4), 2), ((364, 234, 234), 2),
            ((500, 4, 4), 4), ((2000, 4, 4), 16), ((2048, 4, 4), 16), ((140, 90, 90), 1), ((64, 512, 512), 2),
            ((1, 4096, 4096), 1),
        ):  # fmt: skip
            bounds = slabs.slab_bounds(shape)
            assert len(bounds) == count
            assert bounds[0][0] == 0
            assert bounds[-1][1] == shape[0]
            assert all(a[1] == b[0] for a, b in pairwise(bounds))

    @pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
    def test_slabs_project_into_their_own_rows_only(self, geometry, monkeypatch):
        """The line integrals of slabs, each in its own rows, add up to those of the whole."""
        monkeypatch.setattr(slabs, "SLAB_PLANES", 10)
        slab_layout = layout(geometry, circular=False)
        assert len(slab_layout.slabs) == 4
        array = np.random.default_rng(0).random(slab_layout.shape, np.float32)
        whole = project(Volume(array, 0.1), geometry)
        total = np.zeros(whole.shape)
        for k, planes in enumerate(slab_layout.slabs):
            strip = slabs.forward(slabs.new_slab(slab_layout, k, array[slice(*planes)]), np.arange(len(geometry)))
            total[:, strip.first : strip.first + strip.images.shape[1]] += strip.images
        np.testing.assert_allclose(total, whole, atol=2e-5 * whole.max())
