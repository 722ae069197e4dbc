"""The grid of a reconstruction holds all rays that show the sample, and is kept where it does already."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.grid_growth import fitted_grid, growth_views
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.simulate.radiograph import line_integrals
from grainmotion.simulate.sample import Sample, Tube

VOXEL, PANEL, ANGLES = 0.5, (24, 32), np.arange(0, 360, 12.0)
CONE = Geometry.cone(ANGLES, PANEL, 1.0, source_to_axis=100, source_to_detector=200)  # a pixel is a voxel at the axis
PARALLEL = Geometry.parallel(ANGLES, PANEL, VOXEL)
GRID = Volume.zeros((24, 32, 32), VOXEL)


def cylinder(radius: float, low: float = -99.0, high: float = 99.0, center: tuple[float, float] = (0, 0)) -> Sample:
    """An upright cylinder of uniform attenuation; lengths in voxels."""
    x, y = (VOXEL * c for c in center)
    return Sample((), Tube(0.0, radius * VOXEL, 0.1, low * VOXEL, high * VOXEL, (x, y, 0.0)))


def scanned(sample: Sample, geometry: Geometry = CONE, noise: float = 0.0) -> Scan:
    images = line_integrals(sample, geometry, subsamples=1)
    return Scan((images + noise * np.random.default_rng(2).normal(size=images.shape)).astype(np.float32), geometry)


def fitted(scan: Scan, grid: Volume = GRID, **settings: object):
    some = scan.select(growth_views(len(scan)))
    return fitted_grid(some, scan.geometry, grid, ReconstructSettings(**settings))


@pytest.mark.parametrize("geometry", [CONE, PARALLEL])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_sample_that_fits_keeps_its_grid(geometry, noise):
    found = fitted(scanned(cylinder(12, -9, 9), geometry, noise))
    assert found.grid is GRID
    assert found.notes == ()
    assert found.field.holds_all


@pytest.mark.parametrize(("low", "high", "sides"), [(-9, 99, (0, 1)), (-99, 9, (1, 0)), (-99, 99, (1, 1))])
def test_layers_hold_the_rays_of_a_sample_that_goes_on(low, high, sides):
    found = fitted(scanned(cylinder(12, low, high)))
    steepest = 12 / 2 / (100 + 6) * 12  # voxels by which a ray rises from the axis to the side of the sample, nearly
    layers = np.array(found.grid.shape) - GRID.shape
    assert layers[0] in [sum(sides) * n for n in range(int(np.ceil(steepest)), int(np.ceil(steepest)) + 4)]
    assert layers[1:].tolist() == [0, 0]
    assert (found.field.below, found.field.above) == tuple(map(bool, sides))
    steps = (GRID.origin - found.grid.origin) / VOXEL
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    np.testing.assert_allclose(steps[:2], 0, atol=1e-9)


def test_parallel_rays_need_no_more_layers():
    found = fitted(scanned(cylinder(12), PARALLEL))
    assert found.grid is GRID
    assert found.field.above
    assert found.field.below


@pytest.mark.parametrize("geometry", [CONE, PARALLEL])
@pytest.mark.parametrize(("radius", "center"), [(20, (0, 0)), (19, (2, -1))])
def test_outline_of_a_sample_wider_than_the_panel(geometry, radius, center):
    found = fitted(scanned(cylinder(radius, -9, 9, center), geometry))
    reach = (radius + np.hypot(*center)) * VOXEL
    assert reach <= found.field.radius < 1.15 * reach
    assert found.field.beside
    assert found.settings.outline == found.field.radius
    assert min(found.grid.shape[1:]) * VOXEL / 2 >= found.field.radius


def test_the_outline_can_be_told():
    scan = scanned(cylinder(20, -9, 9))
    assert fitted(scan, outline="grid").grid is GRID
    told = fitted(scan, outline=21 * VOXEL)
    assert told.grid.shape == (24, 42, 42)
    assert told.settings.outline == 21 * VOXEL
    roomy = Volume.zeros((24, 42, 42), VOXEL)
    assert fitted(scan, roomy).grid is roomy
    assert fitted(scan, roomy).field.radius == 21 * VOXEL
    assert fitted(scan, roomy).field.beside


def test_a_part_of_what_the_panel_sees_can_be_reconstructed():
    small = Volume.zeros((24, 16, 16), VOXEL)
    found = fitted(scanned(cylinder(12, -9, 9)), small)
    assert found.grid is small
    assert not found.field.beside


def test_dead_pixels_do_not_count():
    scan = scanned(cylinder(12, -9, 9))
    images, valid = scan.line_integrals.copy(), np.ones(scan.line_integrals.shape, bool)
    valid[:, -2:], valid[:, :, :3] = False, False
    images[~valid] = 1e4
    found = fitted(Scan(images, scan.geometry, valid))
    assert found.grid is GRID
    assert found.field.holds_all


def test_half_of_a_panel_that_sees_all_in_a_full_turn():
    beside_axis = CONE.window((0, 12), PANEL)  # its first column sees the sample, beyond the axis
    found = fitted(scanned(cylinder(14, -9, 9), beside_axis), Volume.zeros((24, 56, 56), VOXEL))
    assert found.grid.shape == (24, 56, 56)
    assert not found.field.beside


def test_rays_that_leave_the_grid_spoil_it_no_more():
    scan, messages = scanned(cylinder(20, -9, 9)), []
    how = ReconstructSettings(sweeps=3, tolerance=0)
    grown = reconstruct(scan, GRID, how, progress=lambda message, done, total: messages.append(message))
    kept = reconstruct(scan, GRID, replace(how, outline="grid"))
    assert grown.residuals[-1] < 0.7 * kept.residuals[-1]
    assert grown.notes[0] in messages
    assert kept.notes == ()
    assert grown.volume.field is not None
    assert grown.volume.field.beside


@pytest.mark.parametrize("geometry", [CONE, PARALLEL], ids=["cone", "parallel"])
def test_a_grid_beside_the_sample_is_refused(geometry):
    """A centre in voxels instead of mm: the grid would grow over all that is between, and fill the memory."""
    scan = scanned(cylinder(8.0), geometry)
    with pytest.raises(InputError, match=r"volume.center: a grid about \(500.0, 0.0, 0.0\) mm lies beside the panel"):
        fitted(scan, Volume.zeros((24, 32, 32), VOXEL, (500.0, 0.0, 0.0)))
    near = Volume.zeros((24, 32, 32), VOXEL, (4 * VOXEL, 0.0, 0.0))
    assert fitted(scan, near).grid.shape[1] < 64
