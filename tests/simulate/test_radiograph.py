"""Exact line integrals (`simulate.radiograph`): chords, mass, footprints, magnification."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import (
    Ellipsoid,
    Particle,
    Sample,
    Tube,
    ellipsoid_particle,
    line_integrals,
    polyhedron,
    rigid,
    sphere,
    stone,
    transmission,
)

PANEL = DetectorAlignment(detector_offset=(1.0, -2.0), detector_tilts_deg=(3, -2, 4), axis_offset=0.4, first_row="top")
CONE = Geometry.cone([0, 33, 200], (72, 64), 0.5, source_to_axis=60, source_to_detector=200, panel=PANEL)
PARALLEL = Geometry.parallel([0, 33, 200], (72, 64), 0.15, panel=PANEL)
BEAMS = pytest.mark.parametrize("geometry", [CONE, PARALLEL], ids=["cone", "parallel"])


def alone(shape, attenuation=0.1):
    return Sample((Particle(shape, attenuation),))


def rays(geometry, view):
    """Origins and unit directions of the rays through the pixels' centres."""
    pixels = geometry.pixel_positions(view)
    source_or_direction = geometry.vectors[view, :3]
    d = pixels - source_or_direction if geometry.beam == "cone" else np.broadcast_to(source_or_direction, pixels.shape)
    return pixels, d / np.linalg.norm(d, axis=-1, keepdims=True)


def ball_chords(geometry, center, radius):
    out = []
    for view in range(len(geometry)):
        o, d = rays(geometry, view)
        off = np.linalg.norm(np.cross(o - center, d), axis=-1)
        out.append(2 * np.sqrt(np.clip(radius**2 - off**2, 0, None)))
    return np.array(out)


@BEAMS
def test_ellipsoid_ball_has_the_analytic_chord(geometry):
    center = np.array([0.6, -0.4, 0.3])
    ball = Ellipsoid(center, np.full(3, 2.5), rotation_matrix([1.0, 2.0, 0.5]))
    p = line_integrals(alone(ball), geometry, subsamples=1)
    assert np.allclose(p, 0.1 * ball_chords(geometry, center, 2.5), atol=1e-6)


@BEAMS
def test_sphere_mesh_has_nearly_the_chord_of_the_ball(geometry):
    center = np.array([0.6, -0.4, 0.3])
    p = line_integrals(alone(sphere(5.0, level=5).moved(np.eye(3), center)), geometry, subsamples=1)
    expected = 0.1 * ball_chords(geometry, center, 2.5)
    assert np.abs(p - expected)[expected > 0.1].max() < 1e-3  # the mesh is inscribed
    assert p.min() >= -1e-7


@BEAMS
def test_box_has_the_chord_of_three_slabs(geometry):
    rotation, center = rotation_matrix([0.2, 0.5, -0.3]), np.array([0.3, 0.2, -0.5])
    half = np.array([1.5, 1.0, 2.0])
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half
    p = line_integrals(alone(polyhedron(corners).moved(rotation, center)), geometry, subsamples=1)
    for view in range(len(geometry)):
        o, d = rays(geometry, view)
        o, d = (o - center) @ rotation, d @ rotation
        t = np.sort(np.stack([(-half - o) / d, (half - o) / d]), axis=0)
        chord = np.clip(t[1].min(axis=-1) - t[0].max(axis=-1), 0, None)
        assert np.allclose(p[view], 0.1 * chord, atol=1e-6)


def test_axis_aligned_box_edge_on_loses_no_ray():
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    geometry = Geometry.parallel([0, 90], (41, 41), 0.1)  # samples fall exactly on edges and diagonals
    p = line_integrals(alone(polyhedron(corners)), geometry, subsamples=1)
    inside, outside = p[:, 11:30, 11:30], np.delete(p, np.s_[10:31], axis=2)
    assert np.allclose(inside, 0.2, atol=1e-6)
    assert (outside == 0).all()
    assert p.min() > -1e-6
    assert p.max() < 0.2 + 1e-6


@pytest.mark.parametrize("angle", [0.0, 21.0, 90.0, 233.0])
def test_mass_is_conserved_in_every_parallel_view(angle):
    geometry = Geometry.parallel([angle], (100, 100), 0.1, panel=DetectorAlignment(detector_tilts_deg=(0, 0, 25)))
    s, u, v = (geometry.vectors[0, i : i + 3] for i in (0, 6, 9))
    pixel_area = abs(s @ np.cross(u, v))  # of a pixel, across the beam
    for particle in (
        Particle(stone(5, 4.5), 0.1),
        ellipsoid_particle(np.random.default_rng(0), 4.5, 0.1, inclusion_attenuation=0.4),
    ):
        p = line_integrals(Sample((particle,)), geometry, averaging="line-integral", subsamples=4)
        assert p.sum() * pixel_area == pytest.approx(particle.mass, rel=3e-4)


@BEAMS
def test_footprint_moves_as_project_points_predicts(geometry):
    ball = alone(Ellipsoid(np.zeros(3), np.full(3, 0.8), np.eye(3)))
    moved = ball.moved(rigid(ball, (0.7, -0.5, 0.4)))
    rows, columns = np.indices(geometry.shape)
    shift = []
    for sample in (ball, moved):
        p = line_integrals(sample, geometry, averaging="line-integral")
        total = p.sum(axis=(1, 2))
        shift.append(np.stack([(p * rows).sum(axis=(1, 2)), (p * columns).sum(axis=(1, 2))], 1) / total[:, None])
    predicted = geometry.project_points([[0, 0, 0], [0.7, -0.5, 0.4]])
    measured = shift[1] - shift[0]
    # the centroid of a ball's cone-beam footprint differs slightly from its projected centre; the displacement does not
    assert np.allclose(measured, predicted[:, 1] - predicted[:, 0], atol=0.02)


def test_mesh_and_ellipsoid_rotate_alike():
    base = Ellipsoid(np.zeros(3), np.array([1.0, 2.0, 3.0]), np.eye(3))
    mesh = sphere(2.0, level=5).moved(np.diag([1.0, 2.0, 3.0]), np.zeros(3))
    motions = rigid(alone(base), (0.3, 0.2, -0.6), (25.0, -40.0, 60.0))
    a = line_integrals(alone(base).moved(motions), CONE)
    b = line_integrals(alone(mesh).moved(motions), CONE)
    assert np.abs(a - b).mean() < 1e-4


def test_cone_beam_magnifies():
    geometry = Geometry.cone([0], (101, 101), 0.2, source_to_axis=100, source_to_detector=400)
    ball = line_integrals(alone(Ellipsoid(np.zeros(3), np.full(3, 2.0), np.eye(3))), geometry, subsamples=1)
    width = (ball[0, 50] > 0).sum() * 0.2
    assert width == pytest.approx(2 * 2.0 * 4 / np.sqrt(1 - (2 / 100) ** 2), abs=0.4)
    nearer = alone(Ellipsoid(np.array([0, -20.0, 0]), np.full(3, 2.0), np.eye(3)))
    assert (line_integrals(nearer, geometry)[0, 50] > 0).sum() * 0.2 == pytest.approx(4 * 5, abs=0.4)


def test_inclusion_replaces_the_attenuation_of_its_particle():
    ball = Ellipsoid(np.zeros(3), np.full(3, 2.0), np.eye(3))
    core = Ellipsoid(np.zeros(3), np.full(3, 1.0), np.eye(3))
    geometry = Geometry.parallel([0], (3, 3), 0.01)
    p = line_integrals(Sample((Particle(ball, 0.1, ((core, 0.5),)),)), geometry)
    assert p[0, 1, 1] == pytest.approx(2 * 0.1 + 2 * 0.5, rel=1e-4)


def test_tube_wall_is_crossed_twice_and_ends_at_its_top():
    geometry = Geometry.parallel([0, 70], (21, 101), 0.1)
    p = line_integrals(Sample((), Tube(4.0, 4.5, 0.2, top=0.52)), geometry, subsamples=1)
    assert np.allclose(p[:, 10, 50], 0.2 * 2 * 0.5)
    x = 4.2  # between the walls' radii: one chord of the outer circle
    assert np.allclose(p[:, 10, 92], 0.2 * 2 * np.sqrt(4.5**2 - x**2), atol=1e-6)
    assert (p[:, 17:] == 0).all()


@BEAMS
def test_moving_a_tube_is_moving_panel_and_source_back(geometry):
    tube = Tube(2.0, 2.3, 0.2, bottom=-1.5, top=1.8)
    rotation, shift = rotation_matrix([0.3, -0.2, 0.5]), np.array([0.4, -0.3, 0.2])
    back = geometry.vectors.reshape(-1, 4, 3).copy()
    places = [0, 1] if geometry.beam == "cone" else [1]  # the rest are directions
    back[:, places] -= shift
    moved = transmission(Sample((), tube.moved(rotation, shift)), geometry)
    expected = transmission(
        Sample((), tube), Geometry((back @ rotation).reshape(-1, 12), geometry.shape, geometry.beam)
    )
    assert moved.min() < 0.9
    assert np.allclose(moved, expected, atol=1e-12)
    twice = tube.moved(rotation, shift).moved(rotation.T, -rotation.T @ shift)
    assert np.allclose(twice.center, 0)
    assert np.allclose(twice.axes, np.eye(3))


def test_pixel_averages_intensity_not_path():
    edge = alone(polyhedron(np.array(np.meshgrid([0, 9], [-5, 5], [-9, 9])).reshape(3, -1).T), 1.0)
    geometry = Geometry.parallel([0], (1, 1), 0.2)
    half_covered = line_integrals(edge, geometry, subsamples=4)[0, 0, 0]
    assert half_covered == pytest.approx(-np.log((1 + np.exp(-10)) / 2), rel=1e-5)
    assert line_integrals(edge, geometry, subsamples=4, averaging="line-integral")[0, 0, 0] == pytest.approx(5)


def test_beam_hardening_lowers_line_integrals_of_long_paths():
    slab = polyhedron(np.array(np.meshgrid([-9, 9], [-5, 5], [-9, 9])).reshape(3, -1).T)
    geometry = Geometry.parallel([0], (1, 1), 0.2)
    soft_and_hard = ((1.0, 1.5), (1.0, 0.5))
    for attenuation in (0.001, 0.2):
        t = transmission(alone(slab, attenuation), geometry, spectrum=soft_and_hard)[0, 0, 0]
        p = 10 * attenuation
        assert t == pytest.approx((np.exp(-1.5 * p) + np.exp(-0.5 * p)) / 2)
    assert -np.log(t) < p


def test_particle_behind_the_source_is_refused():
    with pytest.raises(InputError, match="behind the source"):
        line_integrals(alone(sphere(4.0).moved(np.eye(3), [0, -60.0, 0])), CONE)


@BEAMS
def test_stone_has_the_chords_of_its_triangles_and_no_seam(geometry):
    mesh = stone(8, 5.0, level=4).moved(rotation_matrix([0.4, 0.1, 2.0]), [0.2, 0.1, -0.3])
    p = line_integrals(alone(mesh), geometry, subsamples=1)
    assert p.min() > -1e-6  # a ray through a seam would give the distance to the source
    assert p.max() < 0.1 * 10
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    o, d = rays(geometry, 1)
    for row, column in np.random.default_rng(0).integers(15, 45, (60, 2)):
        # Möller and Trumbore's intersection with every triangle, double-sided
        origin, ray = o[row, column], d[row, column]
        q = np.cross(ray, c - a)
        det = np.einsum("ij,ij->i", b - a, q)
        s = origin - a
        u = np.einsum("ij,ij->i", s, q) / det
        r = np.cross(s, b - a)
        v = r @ ray / det
        t = np.einsum("ij,ij->i", c - a, r) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1)
        assert p[1, row, column] == pytest.approx(0.1 * -(np.sign(det) * t)[hit].sum(), abs=1e-6)
