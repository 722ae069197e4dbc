"""Surfaces of grains: volume, inertia and distance from solids that are known in closed form."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from grainmotion.errors import InputError
from grainmotion.grain_shapes.mass_properties import mass_properties
from grainmotion.grain_shapes.surface import grain_surface, label_surface
from grainmotion.grain_shapes.triangle_mesh import Surface, subdivided
from grainmotion.model.grains import Grain
from grainmotion.model.volume import Volume
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate.stone_shapes import stone
from grainmotion.simulate.voxelise import inside
from known_solids import PLACE, H, box, ellipsoid, grain, sphere, torus, voxels

SOLIDS = {
    "sphere of 20 voxels": sphere(1.0),
    "ellipsoid of 40 x 30 x 24": ellipsoid(2.0, 1.5, 1.2),
    "ellipsoid of 20 x 16 x 12": ellipsoid(1.0, 0.8, 0.6),
    "box of 30 x 24 x 20": box(3.0, 2.4, 2.0),
    "torus, 10 thick": torus(1.2, 0.5),
}


@pytest.fixture(scope="module")
def images():
    return {name: voxels(solid) for name, solid in SOLIDS.items()}


class TestKnownSolids:
    @pytest.mark.parametrize("finer", [1, 2])
    @pytest.mark.parametrize("name", SOLIDS)
    def test_volume_centre_inertia_and_distance(self, images, name, finer):
        solid = SOLIDS[name]
        surface = grain_surface(grain(images[name], finer=finer))
        found = mass_properties(surface)
        assert surface.source == "attenuation"
        assert found.volume == pytest.approx(solid.volume, rel=0.005)
        np.testing.assert_allclose(found.center, PLACE, atol=0.02 * H)
        scale = np.linalg.norm(solid.moments)
        np.testing.assert_allclose(found.inertia, solid.inertia, atol=0.008 * scale)
        edges = 0.4 if name.startswith("box") else 0.25  # voxels; measured 0.31 and 0.21
        assert np.abs(solid.there(surface.vertices)).max() < edges * H
        middles = surface.corners.mean(axis=1)
        assert np.abs(solid.there(middles)).mean() < 0.06 * H

    @pytest.mark.parametrize("name", SOLIDS)
    def test_closed_and_facing_outwards(self, images, name):
        solid = SOLIDS[name]
        surface = grain_surface(grain(images[name]))
        assert surface.euler_characteristic == solid.euler
        middles, step = surface.corners.mean(axis=1), 0.5 * H
        rising = solid.there(middles + step * surface.normals) - solid.there(middles - step * surface.normals)
        large = np.linalg.norm(np.cross(*(surface.corners[:, 1:] - surface.corners[:, :1]).transpose(1, 0, 2)), axis=1)
        assert (rising[large > 1e-4 * H**2] > 0).all()

    @pytest.mark.parametrize(("blur", "bound"), [(0.5, 0.005), (1.0, 0.012)])
    def test_blur_of_the_image_does_not_shrink_grains(self, images, blur, bound):
        """Without the correction a blur of one voxel takes 3.8 % of this sphere."""
        volume = images["sphere of 20 voxels"]
        blurred = Volume(ndimage.gaussian_filter(volume.array, blur), H)
        found = grain_surface(grain(blurred, reach=3)).volume
        assert found == pytest.approx(SOLIDS["sphere of 20 voxels"].volume, rel=bound)

    def test_noise_and_inclusions_change_little(self, images):
        volume = images["ellipsoid of 40 x 30 x 24"]
        rng = np.random.default_rng(0)
        dense = ndimage.gaussian_filter(rng.normal(size=volume.shape), 2) > 0.1
        array = volume.array * (1 + 0.8 * dense * (ndimage.distance_transform_edt(volume.array > 0.5) > 4))
        noisy = Volume(array + rng.normal(0, 0.05, array.shape).astype(np.float32), H)
        surface = grain_surface(grain(noisy))
        assert surface.volume == pytest.approx(SOLIDS["ellipsoid of 40 x 30 x 24"].volume, rel=0.005)
        assert surface.euler_characteristic == 2

    def test_a_stone_is_met_within_half_a_voxel(self):
        """The exact mesh of a real stone, 24 voxels across, is the truth: Hausdorff distance both ways."""
        truth = stone(7, 2.4, level=4)
        n, samples = 40, 3
        t = (np.arange(n * samples) + 0.5) / samples * H - n * H / 2
        points = np.stack(np.meshgrid(t, t, t, indexing="ij")[::-1], axis=-1)
        share = inside(truth, points.reshape(-1, 3)).reshape(n, samples, n, samples, n, samples).mean(axis=(1, 3, 5))
        surface = grain_surface(grain(Volume(share.astype(np.float32), H)))
        exact = mass_properties(_as_surface(truth))
        found = mass_properties(surface)
        assert found.volume == pytest.approx(exact.volume, rel=0.003)
        np.testing.assert_allclose(found.principal_moments, exact.principal_moments, rtol=0.005)
        points, others = (subdivided(s, 0.6 * H).vertices for s in (surface, _as_surface(truth)))
        there, back = cKDTree(others).query(points)[0], cKDTree(points).query(others)[0]
        assert max(there.max(), back.max()) < 0.6 * H


def _as_surface(mesh):
    return Surface(mesh.vertices, mesh.faces)


class TestManyGrains:
    def test_touching_grains_are_closed_and_share_the_boundary(self):
        """Two halves of a box, told apart by labels alone: each is closed, and together they are the box."""
        t = (np.arange(40) - 19.5) * H
        x = t[None, None, :] + 0 * t[:, None, None] + 0 * t[None, :, None]
        y, z = t[None, :, None], t[:, None, None]
        whole = np.clip(0.5 - (np.maximum(np.maximum(np.abs(x), np.abs(y)), np.abs(z)) - 1.53) / H, 0, 1)
        labels = np.where(whole > 0.5, np.where(x < 0.05, 1, 2), 0).astype(np.int32)
        for finer in (1, 2):
            grains = grains_from_labels(Volume(whole.astype(np.float32), H), labels, reach=1.5, finer=finer).grains
            surfaces = [grain_surface(g) for g in grains]
            assert [s.euler_characteristic for s in surfaces] == [2, 2]
            assert sum(s.volume for s in surfaces) == pytest.approx(3.06**3, rel=0.02)

    def test_a_cavity_is_filled_and_loose_pieces_are_left_out(self):
        z, y, x = np.indices((30, 30, 40)) * 1.0
        r = np.sqrt((x - 14) ** 2 + (y - 14) ** 2 + (z - 14) ** 2)
        array = np.clip(10.5 - r, 0, 1)
        hollow = array * (1 - np.clip(3.5 - r, 0, 1))
        speck = np.clip(3.5 - np.sqrt((x - 33) ** 2 + (y - 14) ** 2 + (z - 14) ** 2), 0, 1)
        full, found = (grain_surface(_grain(a)) for a in (array, hollow + speck))
        assert found.volume == pytest.approx(full.volume, rel=1e-3)
        assert found.euler_characteristic == 2
        assert found.other_pieces == pytest.approx(27 / 1000, rel=0.15)

    def test_an_image_of_labels_gives_a_smooth_surface_of_their_volume(self, images):
        volume = images["ellipsoid of 40 x 30 x 24"]
        binary = Volume((volume.array > 0.5).astype(np.float32), H)
        surface, solid = grain_surface(grain(binary)), SOLIDS["ellipsoid of 40 x 30 x 24"]
        assert surface.source == "labels"
        assert surface.volume == pytest.approx(binary.array.sum() * H**3, rel=1e-3)
        assert np.abs(solid.there(surface.vertices)).max() < 0.5 * H
        same = label_surface(binary.array.astype(np.int32) * 3, 3, binary)
        np.testing.assert_allclose(same.volume, surface.volume, rtol=1e-6)
        np.testing.assert_allclose(mass_properties(same).center, PLACE, atol=0.05 * H)

    def test_what_has_no_surface_is_said(self):
        array = np.zeros((9, 9, 9))
        array[4, 4, 1:8] = 1
        thin = Grain(5, Volume(array, H), np.zeros(3))
        with pytest.raises(InputError, match=r"grain 5.*7 voxels"):
            grain_surface(thin)
        with pytest.raises(InputError, match=r"label 9.*0 voxels"):
            label_surface(np.zeros((4, 4, 4), np.int32), 9, Volume.zeros((4, 4, 4), H))
        with pytest.raises(InputError, match="not the grid's"):
            label_surface(np.zeros((4, 4, 4), np.int32), 9, Volume.zeros((4, 4, 5), H))
        with pytest.raises(InputError, match="grains"):
            grain_surface(Volume.zeros((4, 4, 4), H))


def _grain(array):
    return Grain(1, Volume(np.pad(array, 2), H), np.zeros(3))


def test_a_slice_of_one_layer_is_a_plate():
    """Planar samples have one layer of voxels: the surface is a closed plate of the disc's area and one voxel thick."""
    y, x = np.indices((40, 40)) - 19.5
    disc = np.clip(12.5 - np.hypot(x, y), 0, 1)[None].astype(np.float32)
    surface = grain_surface(Grain(1, Volume(disc, H), np.zeros(3)))
    assert surface.euler_characteristic == 2
    assert surface.volume == pytest.approx(np.pi * 12**2 * H**3, rel=0.1)
