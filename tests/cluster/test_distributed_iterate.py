"""A volume held in slabs: the same image as a whole one, from files that only the slabs' holders read."""

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
from inline_work import InlineExecutor
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
        panel=DetectorAlignment(tilts_deg=(3.0, 2.0, 4.0), offset=(0.3, -0.5)),
    ),
    "parallel, upside down": Geometry.parallel(
        np.arange(0, 180, 10), (50, 40), 0.1, panel=DetectorAlignment(first_row="top")
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return find_inputs(read_experiment(write_tiny(tmp_path_factory.mktemp("scan"))))


@pytest.fixture
def shelf(tmp_path):
    shelf = SharedStore(tmp_path)
    yield shelf
    shelf.close()


def layout(geometry, shape=(40, 30, 30), **settings):
    return slabs.Layout.of(Volume.zeros(shape, 0.1), geometry, ReconstructSettings(**settings))


@pytest.fixture(params=[100, 10], ids=["one slab", "slabs"])
def thickness(request, monkeypatch):
    monkeypatch.setattr(slabs, "SLAB_PLANES", request.param)


@pytest.mark.usefixtures("thickness")
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS.keys())
def test_same_bits(inputs, shelf, settings):
    source = inputs.reference
    one = reconstruct(source.read()[0], inputs.grid, settings)
    many = reconstruct_distributed(InlineExecutor(), shelf, source, inputs.grid, settings, None)
    assert one.volume.array.max() > 0.5
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals
    assert (many.volume.center, many.volume.voxel_size) == (one.volume.center, one.volume.voxel_size)
    assert not list(shelf.folder.glob("planes*"))


@pytest.mark.usefixtures("thickness")
@pytest.mark.parametrize("everywhere", [True, False])
def test_masked_and_chosen_views(tmp_path, shelf, everywhere):
    """Some of the views, dead pixels in all or a saturated one in one of them, more subsets than views."""
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
    many = reconstruct_distributed(InlineExecutor(), shelf, source, grid, settings, None)
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals


@pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
@pytest.mark.parametrize("method", ["sart", "accelerated"])
def test_same_bits_of_any_view(tmp_path, shelf, monkeypatch, geometry, method):
    """Of a grid that is smaller than the panel, not about the axis, and of an odd number of planes."""
    monkeypatch.setattr(slabs, "SLAB_PLANES", 10)
    rng = np.random.default_rng(0)
    np.save(tmp_path / "scan.npy", rng.random((len(geometry), *geometry.shape), np.float32))
    source = ScanInput("scan", find_stack(tmp_path / "scan.npy"), None, None, "line-integrals", geometry)
    grid, settings = Volume.zeros((31, 27, 29), 0.1, (0.2, -0.1, 0.3)), ReconstructSettings(method=method)
    one = reconstruct(source.read()[0], grid, settings)
    many = reconstruct_distributed(InlineExecutor(), shelf, source, grid, settings, None)
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals


def test_same_bits_of_a_coarse_start_in_pieces(tmp_path, shelf, monkeypatch):
    """A tilted panel of an odd number of pixels, far away."""
    monkeypatch.setattr(slabs, "SLAB_PLANES", 20)
    panel = DetectorAlignment(tilts_deg=(1.0, 0.5, 0.5), offset=(0.3, -0.5))
    far = {"source_to_axis": 600, "source_to_detector": 1200, "panel": panel}
    geometry = Geometry.cone(np.arange(0, 360, 10), (165, 61), 0.2, **far)
    np.save(tmp_path / "scan.npy", np.random.default_rng(0).random((36, 165, 61), np.float32))
    source = ScanInput("scan", find_stack(tmp_path / "scan.npy"), None, None, "line-integrals", geometry)
    grid, settings = Volume.zeros((80, 40, 40), 0.1), ReconstructSettings(method="accelerated")
    assert len(pieces_of(slabs.Layout.of(grid, geometry, settings))) > 1
    one = reconstruct(source.read()[0], grid, settings)
    many = reconstruct_distributed(InlineExecutor(), shelf, source, grid, settings, None)
    np.testing.assert_array_equal(many.volume.array, one.volume.array)
    assert many.residuals == one.residuals


def test_stored_now_and_then(inputs, shelf, monkeypatch):
    monkeypatch.setattr(slabs, "SLAB_PLANES", 10)
    work = InlineExecutor()
    reconstruct_distributed(work, shelf, inputs.reference, inputs.grid, ReconstructSettings(method="accelerated"), None)
    walked = 44 * 8 + 8 * 16
    assert work.done.count("restored") == 2 * ((walked - 1) // VIEWS_BETWEEN_CHECKPOINTS)  # not after the last update
    assert len(list(shelf.folder.glob("slab-*"))) <= 2


@pytest.mark.parametrize("momentum", [0.0, 0.9])
def test_from_the_file_or_from_memory(tmp_path, momentum):
    """What a worker holds, it does not read."""
    place = layout(GEOMETRIES["cone"])
    image = np.random.default_rng(0).random(place.shape, np.float32)
    slab = slabs.new_slab(place, 0, image)
    kept = tasks.SlabState(replace(slab, before=2 * slab.image if momentum else None), np.ones((50, 2)))
    tasks.store(kept, tmp_path / "slab")
    held = tasks.restored(place, 0, tmp_path / "slab", momentum)
    assert held.slab is kept.slab
    del kept, held
    read = tasks.restored(place, 0, tmp_path / "slab", momentum)
    assert read.slab is not slab
    np.testing.assert_array_equal(read.slab.image, slab.image)
    np.testing.assert_array_equal(read.slab.planes, 2 * image if momentum else image)


def test_each_radiograph_is_read_once_and_by_workers(inputs, shelf):
    work = InlineExecutor()
    DistributedIterate(work, shelf, inputs.reference, inputs.grid, ReconstructSettings(sweeps=1))
    assert work.done.count("load_views") == 3  # 40 views, 16 together


class TestSlabs:
    def test_cover_the_volume(self):
        for shape, count in (
            ((1, 4, 4), 1), ((28, 4, 4), 1), ((280, 180, 180), 2), ((280, 4, 4), 2), ((364, 234, 234), 2),
            ((500, 4, 4), 4), ((2000, 4, 4), 16), ((2048, 4, 4), 16), ((140, 90, 90), 1), ((64, 512, 512), 2),
            ((1, 4096, 4096), 1),
        ):  # fmt: skip
            found = slabs.slab_bounds(shape)
            assert len(found) == count
            assert found[0][0] == 0
            assert found[-1][1] == shape[0]
            assert all(a[1] == b[0] for a, b in pairwise(found))

    @pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
    def test_shade_no_other_rows(self, geometry, monkeypatch):
        """The line integrals of slabs, each in its own rows, add up to those of the whole."""
        monkeypatch.setattr(slabs, "SLAB_PLANES", 10)
        place = layout(geometry, circular=False)
        assert len(place.slabs) == 4
        array = np.random.default_rng(0).random(place.shape, np.float32)
        whole = project(Volume(array, 0.1), geometry)
        total = np.zeros(whole.shape)
        for k, planes in enumerate(place.slabs):
            strip = slabs.forward(slabs.new_slab(place, k, array[slice(*planes)]), np.arange(len(geometry)))
            total[:, strip.first : strip.first + strip.images.shape[1]] += strip.images
        np.testing.assert_allclose(total, whole, atol=2e-5 * whole.max())
