"""A volume held in slabs: the same image as a whole one, from files that only the slabs' holders read."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from grainmotion.cluster import slabs
from grainmotion.cluster.scattered import Scattered, reconstruct_scattered
from grainmotion.cluster.shelf import Shelf
from grainmotion.experiment.file import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.geometry import Geometry, Panel
from grainmotion.io.tiff import write_tiff
from grainmotion.project import project
from grainmotion.reconstruct import ReconstructSettings, reconstruct
from grainmotion.volume import Volume
from inline_work import InlineWork
from tiny_experiment import PANEL, TOML, write_tiny

SETTINGS = {
    "accelerated": ReconstructSettings(method="accelerated"),
    "sart": ReconstructSettings(sweeps=1),
    "exact": ReconstructSettings(projector="exact", sweeps=1),
    "free": ReconstructSettings(method="accelerated", non_negative=False, circular=False),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return find_inputs(read_experiment(write_tiny(tmp_path_factory.mktemp("scan"))))


@pytest.fixture
def shelf(tmp_path):
    shelf = Shelf(tmp_path)
    yield shelf
    shelf.close()


def layout(geometry, shape=(40, 30, 30), **settings):
    return slabs.Layout(shape, 0.1, (0.0, 0.0, 0.0), geometry, ReconstructSettings(**settings))


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS.keys())
def test_same_volume(inputs, shelf, settings, monkeypatch):
    monkeypatch.setattr(slabs, "THICKNESS", 10)
    source = inputs.reference
    one = reconstruct(source.read()[0], inputs.grid, settings)
    many = reconstruct_scattered(InlineWork(), shelf, source, inputs.grid, settings, None)
    assert one.volume.array.max() > 0.5
    # few views, momentum: what is rounded differently grows a hundredfold
    np.testing.assert_allclose(many.volume.array, one.volume.array, atol=3e-5)
    np.testing.assert_allclose(many.residuals, one.residuals, rtol=1e-5)
    assert (many.volume.center, many.volume.voxel_size) == (one.volume.center, one.volume.voxel_size)
    assert not list(shelf.folder.glob("planes*"))


def test_masked_and_chosen_views(tmp_path, shelf):
    """Some of the views, a panel with dead pixels, more subsets than views."""
    flats = np.full((1, *PANEL), 50_100, np.uint16)
    flats[:, 10:13, 20:23] = 0
    path = write_tiny(
        tmp_path / "tiny", TOML.replace('kind = "counts"', "").replace("[volume]", 'views = "1:"\n[volume]')
    )
    write_tiff(path.parent / "flats.tif", flats)
    source = find_inputs(read_experiment(path)).reference
    grid = find_inputs(read_experiment(path)).grid
    settings = ReconstructSettings(method="accelerated")
    scan = source.read()[0]
    assert scan.valid is not None
    assert len(scan) == 39
    one = reconstruct(scan, grid, settings)
    many = reconstruct_scattered(InlineWork(), shelf, source, grid, settings, None)
    np.testing.assert_allclose(many.volume.array, one.volume.array, atol=3e-5)


def test_stored_now_and_then(inputs, shelf):
    work = InlineWork()
    reconstruct_scattered(work, shelf, inputs.reference, inputs.grid, ReconstructSettings(method="accelerated"), None)
    assert work.done.count("restored") == 2 * (52 // 8)
    assert len(list(shelf.folder.glob("slab-*"))) <= 4


def test_each_radiograph_is_read_once_and_by_workers(inputs, shelf):
    work = InlineWork()
    Scattered(work, shelf, inputs.reference, inputs.grid, ReconstructSettings(sweeps=1))
    assert work.done.count("load_views") == 5  # 40 views, 8 together


class TestSlabs:
    def test_cover_the_volume(self):
        for planes, count in ((1, 1), (2, 2), (28, 2), (280, 2), (2048, 16)):
            cut = layout(Geometry.parallel([0.0], (4, 4), 0.1), (planes, 4, 4)).slabs
            assert len(cut) == count
            assert cut[0][0] == 0
            assert cut[-1][1] == planes
            assert all(a[1] == b[0] for a, b in pairwise(cut))

    @pytest.mark.parametrize(
        "geometry",
        [
            Geometry.cone(np.arange(0, 360, 20), (50, 40), 0.2, source_to_axis=8, source_to_detector=16),
            Geometry.cone(
                np.arange(0, 360, 20), (50, 40), 0.2, source_to_axis=8, source_to_detector=16,
                panel=Panel(tilts_deg=(3.0, 2.0, 4.0), offset=(0.3, -0.5)),
            ),
            Geometry.parallel(np.arange(0, 180, 10), (50, 40), 0.1, panel=Panel(first_row="top")),
        ],
        ids=["cone", "tilted", "parallel, upside down"],
    )  # fmt: skip
    def test_shade_no_other_rows(self, geometry):
        """The line integrals of slabs, each in its own rows, add up to those of the whole."""
        place = layout(geometry, circular=False)
        rng = np.random.default_rng(0)
        array = rng.random(place.shape, np.float32)
        whole = project(Volume(array, 0.1), geometry)
        total = np.zeros(whole.shape)
        for k, planes in enumerate(place.slabs):
            slab = slabs.new_slab(place, k)
            image = slab.imaging.operator.laid(array[slice(*planes)])
            strip = slabs.forward(replace(slab, image=image), np.arange(len(geometry)))
            total[:, strip.first : strip.first + strip.images.shape[1]] += strip.images
        np.testing.assert_allclose(total, whole, atol=2e-5 * whole.max())
