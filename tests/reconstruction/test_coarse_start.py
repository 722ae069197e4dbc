"""Coarse start in pieces: the same as that of the whole volume, and each ray of a piece stays in its planes."""

from itertools import pairwise

import numpy as np
import pytest

from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.binning import binned_scan
from grainmotion.projection.volumes import project
from grainmotion.reconstruction import coarse_start as module
from grainmotion.reconstruction import slabs
from grainmotion.reconstruction.coarse_start import coarse_start, finer, finer_slab, pieces_of
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct

SHAPE, VOXEL = (80, 30, 30), 0.1
ANGLES = np.arange(0, 360, 6)
GEOMETRIES = {
    "cone": Geometry.cone(ANGLES, (84, 40), 0.2, source_to_axis=60, source_to_detector=120),
    "tilted": Geometry.cone(
        ANGLES, (85, 41), 0.2, source_to_axis=60, source_to_detector=120,
        panel=DetectorAlignment(detector_tilts_deg=(1.0, 0.5, 0.5), detector_offset=(0.3, -0.5)),
    ),
    "parallel, upside down": Geometry.parallel(ANGLES, (85, 40), 0.1, panel=DetectorAlignment(first_row="top")),
}  # fmt: skip
INCLINED = GEOMETRIES["parallel, upside down"].vectors.copy()
INCLINED[:, 2] = 0.9
STEEP = Geometry(INCLINED, (85, 40), "parallel")


@pytest.fixture(params=GEOMETRIES.values(), ids=GEOMETRIES.keys())
def layout(request, monkeypatch):
    return layout_in_slabs(request.param, monkeypatch)


def layout_in_slabs(geometry, monkeypatch, shape=SHAPE):
    monkeypatch.setattr(slabs, "SLAB_PLANES", 20)
    return slabs.Layout.of(Volume.zeros(shape, VOXEL, (0.1, -0.1, 0.2)), geometry, ReconstructSettings())


def smooth_blobs(shape=SHAPE):
    """Gaussian blobs of 3 voxels standard deviation, which a grid twice as coarse resolves."""
    rng, array = np.random.default_rng(0), np.zeros(shape, np.float32)
    z, y, x = np.indices(shape, sparse=True)
    for _ in range(40):
        c = rng.uniform(0, 1, 3) * np.array([shape[0], 16, 16]) + np.array([0, 7, 7])
        array += np.exp(-((z - c[0]) ** 2 + (y - c[1]) ** 2 + (x - c[2]) ** 2) / 18)
    return array


def test_rows_of_a_piece_project_its_planes_only(layout):
    pieces = pieces_of(layout)
    assert len(pieces) >= 2
    rows = layout.geometry.shape[0] // 2
    panel = layout.geometry.window((0, 0), (2 * rows, layout.geometry.shape[1] // 2 * 2)).binned(2)
    coarse = tuple(-(-n // 2) for n in SHAPE)
    cylinder = np.hypot(*(np.indices(coarse[1:]) - 7.0)) <= 7.5  # cylinder that the constraint keeps
    for piece in pieces:
        outside = np.repeat(cylinder[None], coarse[0], axis=0).astype(np.float32)
        outside[slice(*piece.planes)] = 0
        assert project(Volume(outside, 2 * VOXEL, layout.center), panel)[:, slice(*piece.rows)].max() == 0


def test_pieces_cover_all_slabs_with_little_overlap(layout):
    pieces = pieces_of(layout)
    assert [k for piece in pieces for k in piece.slabs] == list(range(len(layout.slabs)))
    assert sum(b - a for a, b in (p.planes for p in pieces)) <= (1 + module.MAX_EXTRA_PLANES) * SHAPE[0] / 2
    for piece in pieces:
        assert piece.planes[0] <= layout.slabs[piece.slabs[0]][0] / 2
        assert piece.planes[1] >= layout.slabs[piece.slabs[-1]][1] / 2


def test_slabs_outside_the_field_of_view(monkeypatch):
    """A grid taller than a detector with an odd number of rows: every piece has at least one row."""
    monkeypatch.setattr(module, "MAX_EXTRA_PLANES", 2.0)  # any overlap is allowed
    panel = GEOMETRIES["parallel, upside down"].window((29, 0), (27, 40))
    layout = layout_in_slabs(panel, monkeypatch)
    assert (26, 27) in layout.footprints
    assert all(0 <= first < end <= 13 for first, end in (piece.rows for piece in pieces_of(layout)))
    images = project(Volume(smooth_blobs(), VOXEL, layout.center), panel)
    settings = ReconstructSettings(method="accelerated")
    reconstructed = reconstruct(Scan(images, panel), Volume.zeros(SHAPE, VOXEL, layout.center), settings).volume.array
    visible = np.s_[30:50, 10:20, 10:20]
    assert np.linalg.norm((reconstructed - smooth_blobs())[visible]) < 0.1 * np.linalg.norm(smooth_blobs()[visible])


def test_inclined_rays_need_one_piece(monkeypatch):
    """The piece is the whole volume."""
    (piece,) = pieces_of(layout_in_slabs(STEEP, monkeypatch))
    assert (piece.slabs, piece.rows, piece.planes) == (range(4), (0, 42), (0, 40))


def test_pieces_equal_the_whole_volume(layout, monkeypatch):
    """Errors of pieces exceed that of the whole volume by at most 2 %."""
    array = smooth_blobs()
    images = project(Volume(array, VOXEL, layout.center), layout.geometry)
    scan = Scan(images, layout.geometry)
    (whole,) = one = whole_as_one_piece(layout, monkeypatch)
    assert len(pieces_of(layout)) > len(one)
    full = finer(coarse_start(binned_scan(scan, 2, rows=whole.rows), layout, whole), SHAPE)
    parts = [
        finer_slab(coarse_start(binned_scan(scan, 2, rows=piece.rows), layout, piece), layout, piece, k)
        for piece in pieces_of(layout)
        for k in piece.slabs
    ]
    y, x = np.indices(SHAPE[1:]) - 14.5
    cylinder = np.hypot(y, x) < 14
    error = np.linalg.norm((full - array)[:, cylinder])
    assert error < 0.2 * np.linalg.norm(array[:, cylinder])
    assert np.linalg.norm((np.concatenate(parts) - array)[:, cylinder]) < 1.02 * error
    assert [len(part) for part in parts] == [b - a for a, b in layout.slabs]


def whole_as_one_piece(layout, monkeypatch):
    """A single piece with all slabs."""
    with monkeypatch.context() as patch:
        patch.setattr(module, "MAX_EXTRA_PLANES", -1)
        return pieces_of(layout)


@pytest.mark.parametrize("shape", [(20, 8, 7), (21, 9, 8), (23, 7, 8)])
def test_interpolation_of_part_of_the_planes(shape):
    """Fine planes interpolated from the coarse planes around them equal those of the whole volume."""
    array = np.random.default_rng(0).random([-(-n // 2) for n in shape], np.float32)
    whole = finer(array, shape)
    for first, end in pairwise((0, 3, 10, shape[0])):
        low, high = max(first // 2 - 1, 0), end // 2 + 2
        np.testing.assert_allclose(finer(array[low:high], shape, slice(first, end), low), whole[first:end], atol=1e-6)
